# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Scripts of requests are read in order of time; a malformed script is refused with its entry."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import InputError
from cdff_dev.mission_replay.script import read_script

START_NS = 1_000_000_000


def read(tmp_path: Path, text: str) -> list[tuple[int, str, str]]:
    path = tmp_path / "requests.yaml"
    path.write_text(text)
    return [(s.at_ns, s.request.product, s.request.id) for s in read_script(path, START_NS, ["mana"])]


def test_requests_are_ordered_by_time(tmp_path: Path) -> None:
    text = (
        "requests:\n- {at_s: 5, type: dem, robot: any}\n"
        "- {at_s: 0.5, type: pose, robot: mana, request: first}\n"
    )
    assert read(tmp_path, text) == [(1_500_000_000, "pose", "first"), (6_000_000_000, "dem", "request-1")]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("requests: []", "expected `requests"),
        ("asked: [1]", "expected `requests"),
        ("requests: [dem]", "request 1 is a str"),
        ("requests: [{type: dem, robot: any}]", "at_s=None"),
        ("requests: [{at_s: -1, type: dem, robot: any}]", "at_s=-1"),
        ("requests: [{at_s: 0, type: cheese, robot: any}]", "request 1: type"),
        ("requests: [{at_s: 0, type: dem, robot: any, every_s: 1}]", "answered once"),
        (
            "requests: [{at_s: 0, type: dem, robot: zhurong}]",
            "request 1: robot='zhurong', expected any or mana",
        ),
        (
            "requests: [{at_s: 0, type: dem, robot: any, request: a}, "
            "{at_s: 1, type: dem, robot: any, request: a}]",
            "occurs twice",
        ),
    ],
)
def test_a_malformed_script_is_refused_with_its_entry(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        read(tmp_path, text)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cdff_common import cli
from cdff_common.errors import InputError
from services.orchestrator.commands import format_of

STAMP_NS = 1_700_000_000_123_456_000


class Answered:
    """Stands for a client whose orchestrator has one job and one pose."""

    data = b"payload"

    def __init__(self, *_: object, **__: object) -> None: ...

    def __enter__(self) -> Answered:
        return self

    def __exit__(self, *_: object) -> None: ...

    def request(self, *_: object, **__: object) -> Answered:
        return self

    def standing(self, *_: object, **wishes: object) -> Iterator[Answered]:
        assert wishes["every_s"] == 2.0
        assert wishes["t_ns"] == STAMP_NS
        while True:
            yield self

    def summary(self) -> dict[str, Any]:
        return {"header": {"t1_ns": STAMP_NS}, "delivered": {"newest_ns": STAMP_NS}}

    def jobs(self, *_: object, **__: object) -> list[dict[str, Any]]:
        return [{"job": "a", "since_ns": STAMP_NS}]


@pytest.fixture
def answered(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cdff_common.client.Client", Answered)


@pytest.mark.parametrize(
    ("product", "name", "form"),
    [
        ("dem", "a.tif", "tif"),
        ("dem", "a.TIFF", "tif"),
        ("pose", "a.msgpack", "msgpack"),
        ("pose", "a.uper", "uper"),
        ("pose", "a.xml", "xer"),
        ("trajectory", "a.tum", "tum"),
        ("image", "a.png", "png"),
    ],
)
def test_the_ending_of_a_file_names_the_format(product: str, name: str, form: str) -> None:
    assert format_of(Path(name), product) == form


@pytest.mark.parametrize(("product", "name"), [("pose", "pose.json"), ("pose", "x"), ("dem", "x.ply")])
def test_an_ending_that_names_no_format_of_the_product_is_refused(product: str, name: str) -> None:
    with pytest.raises(InputError, match=r"names no format of a .*\.uper.*--format"):
        format_of(Path(name), product)


def test_json_carries_stamps_as_decimal_strings(answered: None, capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["request", "pose", "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert (said["header"]["t1_ns"], said["delivered"]["newest_ns"]) == (str(STAMP_NS), str(STAMP_NS))
    assert cli.main(["orchestrator", "jobs", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["jobs"][0]["since_ns"] == str(STAMP_NS)


def test_a_file_that_cannot_be_written_is_one_line_and_exit_1(
    answered: None, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["request", "pose", "--out", str(tmp_path / "none" / "x.tum")]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "there is no folder" in line


def test_format_says_what_a_file_of_any_name_holds(answered: None, tmp_path: Path) -> None:
    path = tmp_path / "pose.dat"
    assert cli.main(["request", "pose", "--format", "uper", "--out", str(path), "--json"]) == 0
    assert path.read_bytes() == Answered.data


def test_a_standing_request_writes_a_line_for_each_answer(answered: None, capsys: pytest.CaptureFixture[str]) -> None:
    asked = ["request", "pose", "--every-s", "2", "--count", "3", "--t", str(STAMP_NS), "--json"]
    assert cli.main(asked) == 0
    assert len(capsys.readouterr().out.splitlines()) == 3


@pytest.mark.parametrize("asked", [["--count", "3"], ["--every-s", "1", "--count", "0"], ["--t", "yesterday"]])
def test_wishes_that_make_no_sense_are_refused(
    answered: None, asked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main(["request", "pose", *asked]) == 1
    assert asked[-2] in capsys.readouterr().err

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Lists of shipped profiles, scenarios and missions."""

from __future__ import annotations

import json

import pytest

from cdff_common.resources import shipped_names, summary_of
from cdff_dev.shipped.commands import print_shipped

KINDS = ("profiles", "simulation", "missions")


@pytest.mark.parametrize("kind", KINDS)
def test_each_shipped_file_starts_with_a_sentence_that_describes_it(kind: str) -> None:
    for name in shipped_names(kind):
        summary = summary_of(kind, name)
        assert summary.endswith("."), name
        assert summary[0].isupper(), name
        assert "Frozen" not in summary, name


def test_a_list_has_a_header_and_its_json_the_names(capsys: pytest.CaptureFixture[str]) -> None:
    assert print_shipped("profiles", as_json=False) == 0
    header, *lines = capsys.readouterr().out.splitlines()
    assert header.split() == ["name", "summary"]
    assert len(lines) == len(shipped_names("profiles"))
    print_shipped("profiles", as_json=True)
    assert [row["name"] for row in json.loads(capsys.readouterr().out)] == shipped_names("profiles")

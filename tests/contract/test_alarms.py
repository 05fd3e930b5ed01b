# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every kind of alarm is raised by a service, explained to operators, and made to happen by a test."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "docs" / "dpm-operation.md").read_text()
KINDS = re.findall(r"^\| `(\w+)` \|", PAGE.partition("\n## Alarms")[2].partition("\n## ")[0], re.MULTILINE)


@cache
def text_of(folder: str) -> str:
    """Return all Python code of a folder, without this file."""
    paths = (path for path in (ROOT / folder).rglob("*.py") if path != Path(__file__))
    return "\n".join(path.read_text() for path in paths)


def test_every_raised_kind_is_on_the_page() -> None:
    code = text_of("services")
    raised = re.findall(r"[Aa]larms\.set\(\s*\"(\w+)\"", code) + re.findall(
        r"^_KIND.*= \"(\w+)\"", code, re.M
    )
    assert {*re.findall(r"_KIND, _SOURCE = \"(\w+)\"", code), *raised} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_a_test_makes_the_alarm_happen(kind: str) -> None:
    assert f'"{kind}"' in text_of("tests") or f"{kind} of" in text_of("tests")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every kind of alarm is raised by a service, explained to operators, and made to happen by a test."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

import pytest

from cdff_core.consistency.finding import KINDS as SENSOR_KINDS
from services.orchestrator.mode_alarms import REMEDIES

ROOT = Path(__file__).resolve().parents[2]
SECTION = (ROOT / "docs" / "dpm-operation.md").read_text().partition("\n## Alarms")[2].partition("\n## ")[0]
EXPLANATIONS, _, LISTED_TESTS = SECTION.partition("\nEach alarm is raised by a test:")
KINDS = re.findall(r"^\| `(\w+)` \|", EXPLANATIONS, re.MULTILINE)
TESTS = dict(re.findall(r"^\| `(\w+)` \| `(test_\w+)` \|$", LISTED_TESTS, re.MULTILINE))


@cache
def texts_of(folder: str) -> tuple[str, ...]:
    """Return the Python files of a folder, without this file."""
    paths = (path for path in (ROOT / folder).rglob("*.py") if path != Path(__file__))
    return tuple(path.read_text() for path in paths)


def test_every_raised_kind_is_on_the_page() -> None:
    code = "\n".join(texts_of("services"))
    raised = re.findall(r"[Aa]larms\.set\(\s*\"(\w+)\"", code) + re.findall(
        r"^_KIND.*= \"(\w+)\"", code, re.M
    )
    assert {*re.findall(r"_KIND, _SOURCE = \"(\w+)\"", code), *raised, *REMEDIES, *SENSOR_KINDS} == set(KINDS)


@pytest.mark.parametrize("kind", KINDS)
def test_the_listed_test_makes_the_alarm_happen(kind: str) -> None:
    (code,) = (text for text in texts_of("tests") if f"def {TESTS[kind]}(" in text)
    assert re.search(rf"\b{kind}\b", code)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outcomes of the tests of the store by subject and engine."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

from evaluation.store_engines import ROOT, SUBJECTS, TESTS, counted, table

REPORT = """<testsuite>
<testcase classname="tests.unit.dpm_store.search.test_search" name="test_a[sqlite]"/>
<testcase classname="tests.unit.dpm_store.search.test_search" name="test_a[postgresql]"><failure/></testcase>
<testcase classname="tests.unit.dpm_store.search.test_search" name="test_a[x-postgresql+s3]">
<skipped message="no server"/></testcase>
<testcase classname="tests.unit.dpm_store.changes.test_migration" name="test_b"/>
<testcase classname="tests.unit.dpm_store.changes.test_migration" name="test_c"><error/></testcase>
</testsuite>"""
SEARCH = "searches, earlier states (as-of)"


def test_outcomes_are_counted_by_subject_and_engine_and_failures_are_named() -> None:
    figures = counted(ElementTree.fromstring(REPORT).iter("testcase"))
    assert figures["subjects"] == {
        SEARCH: {"sqlite": {"passed": 1}, "postgresql": {"failed": 1}, "s3": {"skipped": 1}},
        "`cdff dpm migrate`": {"other": {"passed": 1, "failed": 1}},
    }
    assert figures["skipped"] == {"no server": 1}
    assert figures["failed"] == [
        "tests.unit.dpm_store.search.test_search::test_a[postgresql]",
        "tests.unit.dpm_store.changes.test_migration::test_c",
    ]
    text = table(figures)
    assert f"| {SEARCH} | 1 passed | 1 failed | 1 skipped | – |" in text
    assert "| all | 1 passed | 1 failed | 1 skipped | 1 passed, 1 failed |" in text
    assert "Failed: `tests.unit.dpm_store.changes.test_migration::test_c`" in text


def test_every_subject_has_a_module_that_is_executed() -> None:
    executed = [path for name in TESTS for path in _modules(ROOT / name)]
    names = [str(path.relative_to(ROOT).with_suffix("")).replace("/", ".") for path in executed]
    subjects = {next(text for start, text in SUBJECTS.items() if name.startswith(start)) for name in names}
    assert subjects == set(SUBJECTS.values())


def _modules(path: Path) -> list[Path]:
    return sorted(path.rglob("test_*.py")) if path.is_dir() else [path]

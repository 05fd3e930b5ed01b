# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The tests of the store on each of its engines, counted by subject.

The engines are SQLite with files, PostgreSQL with PostGIS, and the same with payloads in an S3 object store.
One run of pytest executes all tests; its report in JUnit's format is counted.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from cdff_common.errors import StorageError

ROOT = Path(__file__).resolve().parents[1]
#: Engines by the start of the parameter of a test; a test without such a parameter does not depend on them.
ENGINES = {"postgresql+s3": "s3", "postgresql": "postgresql", "sqlite": "sqlite"}
NONE = "other"
#: Subjects by the start of the module's name; the first that fits counts.
SUBJECTS = {
    "tests.unit.dpm_store.products.test_transaction": "transactions",
    "tests.unit.dpm_store.products": "products, batches, annotations",
    "tests.unit.dpm_store.search": "searches, earlier states (as-of)",
    "tests.unit.dpm_store.frames": "frames, re-anchoring",
    "tests.unit.dpm_store.maps": "maps",
    "tests.unit.dpm_store.history.test_backup": "backup",
    "tests.unit.dpm_store.engine.test_server_backup": "backup: dump, earlier time",
    "tests.unit.dpm_store.history": "history, retention, provenance",
    "tests.unit.dpm_store.payloads": "payloads, objects, cache",
    "tests.unit.dpm_store.test_faults": "corruption, full disk, failed writes",
    "tests.unit.dpm_store.engine.test_migrate": "schema migrations",
    "tests.unit.dpm_store.engine.test_postgresql": "kills of servers, credentials, versions, clocks",
    "tests.unit.dpm_store.engine": "engine",
    "tests.unit.dpm_store.changes.test_migration": "`cdff dpm migrate`",
    "tests.unit.dpm_store.changes": "change files, rebuild",
    "tests.unit.dpm_store": "concurrent writers, state machine, views",
    "tests.integration.test_dpm_workers": "processes: kills of DPM, worker and database",
    "tests.integration": "processes: several writers, missing database",
}
TESTS = (
    "tests/unit/dpm_store",
    "tests/integration/test_dpm_workers.py",
    "tests/integration/test_dpm_writers.py",
    "tests/integration/test_dpm_durability.py",
)
_PROCESSES = 2
_OUTCOMES = ("passed", "skipped", "failed")


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the outcomes by subject and engine, and the reasons of skipped tests; no data are used.

    Raises
    ------
    StorageError
        If pytest ended without a report.
    """
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [sys.executable, "-m", "pytest", "-q", "-n", str(_PROCESSES), "-m", "", *TESTS]
        progress(f"store_engines: {' '.join(command[1:])}")
        done = subprocess.run(
            [*command, f"--junitxml={report}"], cwd=ROOT, capture_output=True, text=True, check=False
        )
        if not report.is_file():
            raise StorageError(f"pytest wrote no report: {(done.stdout + done.stderr)[-500:]}")
        return counted(ElementTree.parse(report).iter("testcase")) | {"command": " ".join(command[1:])}


def counted(cases: Iterable[ElementTree.Element]) -> dict[str, Any]:
    """Count the test cases by subject, engine and outcome; return reasons of skips, names of failures too."""
    rows: dict[str, dict[str, Counter[str]]] = {}
    skipped: Counter[str] = Counter()
    failed = []
    for case in cases:
        module, name = case.get("classname", ""), case.get("name", "")
        subject = next((text for start, text in SUBJECTS.items() if module.startswith(start)), module)
        outcome = "passed"
        if (skip := case.find("skipped")) is not None:
            outcome = "skipped"
            skipped[skip.get("message", "")] += 1
        elif case.find("failure") is not None or case.find("error") is not None:
            outcome = "failed"
            failed.append(f"{module}::{name}")
        rows.setdefault(subject, {}).setdefault(engine_of(name), Counter())[outcome] += 1
    order = list(dict.fromkeys(SUBJECTS.values()))
    return {
        "subjects": {subject: rows[subject] for subject in sorted(rows, key=order.index)},
        "skipped": skipped,
        "failed": failed,
    }


def engine_of(name: str) -> str:
    """Return the engine of a test from its parameters."""
    _, _, parameters = name.partition("[")
    return next((engine for text, engine in ENGINES.items() if text in parameters), NONE)


def table(figures: Mapping[str, Any]) -> str:
    """Return the table of the outcomes."""
    names = {"sqlite": "SQLite", "postgresql": "PostGIS", "s3": "PostGIS and S3", NONE: "no engine"}
    lines = [
        "| subject | " + " | ".join(names.values()) + " |",
        "|---|" + "---|" * len(names),
    ]
    total: dict[str, Counter[str]] = {engine: Counter() for engine in names}
    for subject, by_engine in figures["subjects"].items():
        for engine, counts in by_engine.items():
            total[engine].update(counts)
        lines.append(f"| {subject} | " + " | ".join(_cell(by_engine.get(e, {})) for e in names) + " |")
    lines.append("| all | " + " | ".join(_cell(total[engine]) for engine in names) + " |")
    lines += ["", *(f"Failed: `{name}`" for name in figures["failed"])]
    lines += [f"Skipped, {count}: {reason}" for reason, count in sorted(figures["skipped"].items())]
    return "\n".join(lines).rstrip()


def _cell(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{counts[outcome]} {outcome}" for outcome in _OUTCOMES if counts.get(outcome)) or "–"

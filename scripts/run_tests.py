# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the tests: first those that only compute, in parallel, then those that start processes, one by one.

``run_tests.py`` runs the tests that are not marked slow or soak, ``run_tests.py --slow`` the slow ones too,
``run_tests.py --soak`` only the soak tests; further arguments go to pytest.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Iterable
from pathlib import Path
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
NO_TESTS_COLLECTED = 5
PROCESSES = "integration or e2e"


def main() -> int:
    """Run both parts and print a summary; return 0 only if both passed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slow", action="store_true", help="also the tests marked slow")
    parser.add_argument("--soak", action="store_true", help="only the tests marked soak")
    parser.add_argument("--workers", default="2", help="processes for the computing part")
    args, rest = parser.parse_known_args()
    BUILD.mkdir(exist_ok=True)
    (BUILD / "traceability.json").unlink(missing_ok=True)
    selected = "soak" if args.soak else "not soak" if args.slow else "not soak and not slow"
    started = time.monotonic()
    parts = {
        "compute": [
            "-m",
            f"not ({PROCESSES}) and {selected}",
            "-n",
            args.workers,
            "--dist",
            "loadfile",
            *rest,
        ],
        "processes": ["-m", f"({PROCESSES}) and {selected}", "-p", "no:xdist", *rest],
    }
    codes = {name: _pytest(name, arguments) for name, arguments in parts.items()}
    counts = _counts(BUILD / f"junit-{name}.xml" for name in parts)
    seconds = time.monotonic() - started
    words = [f"{counts[word]} {word}" for word in ("failed", "passed", "skipped", "errors") if counts[word]]
    print(f"\n==== {', '.join(words) or 'no tests ran'} in {seconds:.2f}s ====")
    return next((code for code in codes.values() if code), 0)


def _pytest(name: str, arguments: list[str]) -> int:
    """Run pytest; threads are limited, because the processes already use all cores."""
    caps = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    report = BUILD / f"junit-{name}.xml"
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", f"--junitxml={report}", *arguments]
    code = subprocess.run(
        command, cwd=ROOT, env=caps | os.environ, stdin=subprocess.DEVNULL, check=False
    ).returncode
    return 0 if code == NO_TESTS_COLLECTED else code


def _counts(reports: Iterable[Path]) -> dict[str, int]:
    counts = {"passed": 0, "failed": 0, "skipped": 0, "errors": 0}
    for report in reports:
        if not report.is_file():
            continue
        for suite in ElementTree.parse(report).getroot().iter("testsuite"):
            failed, errors, skipped = (int(suite.get(k, "0")) for k in ("failures", "errors", "skipped"))
            counts["failed"] += failed
            counts["errors"] += errors
            counts["skipped"] += skipped
            counts["passed"] += int(suite.get("tests", "0")) - failed - errors - skipped
    return counts


if __name__ == "__main__":
    sys.exit(main())

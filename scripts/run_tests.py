# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the tests in two parts: tests that start processes, and tests that only compute.

Tests that start processes run one by one, because they wait for services within time limits. Tests that only
compute run in parallel at the same time, in the remaining processor time; the output of the others is printed
when they have ended. Linux shares the processors among sessions first, and the services under test run in
sessions of their own. The tests that only compute therefore run in a session of the lowest priority until
the others have ended. Tests that failed run once more when nothing else runs, because services and tests with
real time may miss their time limits while others compute. They are listed, and fail if they fail again.

``run_tests.py`` runs the tests that are not marked slow or soak, ``run_tests.py --slow`` the slow ones too,
``run_tests.py --soak`` only the soak tests; further arguments go to pytest.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import IO
from xml.etree import ElementTree

ROOT = Path(__file__).resolve().parent.parent
BUILD = ROOT / "build"
NO_TESTS_COLLECTED = 5
PROCESSES = "integration or e2e"
#: Folders without tests that start processes, which need not be collected for these.
COMPUTE_ONLY = [f"--ignore=tests/{folder}" for folder in ("contract", "golden", "interop", "unit")]
LOWEST_PRIORITY = 19
#: Exit code of pytest if tests have failed, and largest number of tests that run once more.
TESTS_FAILED, MOST_REPEATED = 1, 10


def main() -> int:
    """Run both parts and print a summary; return 0 only if both passed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slow", action="store_true", help="also the tests marked slow")
    parser.add_argument("--soak", action="store_true", help="only the tests marked soak")
    parser.add_argument("--workers", default="2", help="processes for the computing part")
    args, pytest_arguments = parser.parse_known_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(128 + signal.SIGTERM))
    BUILD.mkdir(exist_ok=True)
    (BUILD / "traceability.json").unlink(missing_ok=True)
    selected = "soak" if args.soak else "not soak" if args.slow else "not soak and not slow"
    started = time.monotonic()
    output = BUILD / "processes.log"
    with output.open("wb") as log:
        processes = _start(
            "processes",
            ["-m", f"({PROCESSES}) and {selected}", "-p", "no:xdist", *COMPUTE_ONLY, *pytest_arguments],
            stdout=log,
        )
        compute = _start(
            "compute",
            [
                "-m",
                f"not ({PROCESSES}) and {selected}",
                "-n",
                args.workers,
                "--dist",
                "loadfile",
                *pytest_arguments,
            ],
            start_new_session=True,
        )
        try:
            os.setpriority(os.PRIO_PROCESS, compute.pid, LOWEST_PRIORITY)  # its workers inherit the priority
            _set_session_priority(compute.pid, LOWEST_PRIORITY)
            code = processes.wait()
            _set_session_priority(compute.pid, 0)
            codes = [compute.wait(), code]
        finally:
            processes.terminate()  # no effect on a process that has ended
            with suppress(ProcessLookupError):  # a signal to this process does not reach another session
                os.killpg(compute.pid, signal.SIGTERM)
    print(output.read_text(encoding="utf-8", errors="replace"))
    counts = _counts(BUILD / f"junit-{name}.xml" for name in ("compute", "processes"))
    failed = [test for name in ("compute", "processes") for test in _failed(BUILD / f"junit-{name}.xml")]
    passed = 0
    if {*codes} <= {0, TESTS_FAILED, NO_TESTS_COLLECTED} and 0 < len(failed) <= MOST_REPEATED:
        print(f"\n==== {len(failed)} tests run once more, alone: {', '.join(failed)}", flush=True)
        codes = [_start("repeated", ["-p", "no:xdist", *failed]).wait()]
        passed = _counts([BUILD / "junit-repeated.xml"])["passed"]
        counts["failed"], counts["passed"] = counts["failed"] - passed, counts["passed"] + passed
    seconds = time.monotonic() - started
    words = [f"{counts[word]} {word}" for word in ("failed", "passed", "skipped", "errors") if counts[word]]
    words += [f"{passed} of them only when repeated alone"] if passed else []
    print(f"\n==== {', '.join(words) or 'no tests ran'} in {seconds:.2f}s ====")
    return next((code for code in codes if code not in (0, NO_TESTS_COLLECTED)), 0)


def _start(
    name: str, arguments: list[str], stdout: IO[bytes] | None = None, start_new_session: bool = False
) -> subprocess.Popen[bytes]:
    """Start pytest; threads are limited, because the processes already use all cores."""
    caps = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}
    report = BUILD / f"junit-{name}.xml"
    report.unlink(missing_ok=True)
    command = [sys.executable, "-m", "pytest", f"--junitxml={report}", *arguments]
    return subprocess.Popen(
        command,
        cwd=ROOT,
        env=caps | os.environ,
        stdin=subprocess.DEVNULL,
        stdout=stdout,
        start_new_session=start_new_session,
    )


def _set_session_priority(pid: int, nice: int) -> None:
    """Set the priority of the session of a process, if Linux groups processes by sessions."""
    with suppress(OSError):
        Path(f"/proc/{pid}/autogroup").write_text(str(nice), encoding="ascii")


def _failed(report: Path) -> list[str]:
    """Return the node ids of the tests of a report that failed or had an error."""
    if not report.is_file():
        return []
    cases = ElementTree.parse(report).getroot().iter("testcase")
    failed = [c for c in cases if c.find("failure") is not None or c.find("error") is not None]
    return [f"{c.get('classname', '').replace('.', '/')}.py::{c.get('name')}" for c in failed]


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

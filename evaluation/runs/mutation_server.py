# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Process that runs tests in forks of itself, so that libraries are imported only once.

Each line of standard input is a JSON object with ``arguments`` of pytest, ``cpu_s`` and ``idle_s`` (limits of
the CPU time and of the time in which the process waits for something else than a processor).
Each line of standard output is the result: ``outcome`` (passed, failed or timeout), ``test`` (the first that
failed), ``seconds`` (CPU) and ``waited_s`` (elapsed less CPU time of that test).
"""

from __future__ import annotations

import importlib
import json
import os
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest

#: Libraries whose import takes longest; no package of the tree, since its files change.
_LIBRARIES = (
    "cv2", "fastapi", "hypothesis", "laspy", "msgpack", "numba", "pydantic", "pyproj", "rasterio",
    "scipy.ndimage", "scipy.optimize", "scipy.sparse.linalg", "scipy.spatial", "shapely", "small_gicp",
    "sqlalchemy",
)  # fmt: skip
_OPTIONS = [
    "-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", "-p", "no:xdist",
    "-W", "ignore::pytest.PytestAssertRewriteWarning",  # of the imported libraries that have plug-ins
    "-o", "timeout=0",  # of elapsed time
    "-m", "not slow and not soak and not integration and not e2e",
]  # fmt: skip


class _FirstFailure:
    """pytest plug-in."""

    def __init__(self) -> None:
        self.test, self.waited_s = "", 0.0
        self._cpu_s = time.process_time()

    def pytest_runtest_logstart(self) -> None:
        self._cpu_s = time.process_time()

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed and not self.test:
            self.test = report.nodeid

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and not self.test:
            self.test = report.nodeid
            self.waited_s = max(report.duration - (time.process_time() - self._cpu_s), 0.0)


def main() -> None:
    """Answer requests until the input ends."""
    for library in _LIBRARIES:
        importlib.import_module(library)
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_run(**json.loads(line))) + "\n")
        sys.stdout.flush()


def _run(arguments: list[str], cpu_s: int, idle_s: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        answer = Path(folder) / "answer.json"
        process, started = os.fork(), time.monotonic()
        if process == 0:
            _run_in_fork([*arguments, f"--basetemp={folder}/pytest"], answer, cpu_s)
        ended, status = os.waitpid(process, os.WNOHANG)
        while ended == 0:
            if time.monotonic() - started - _scheduled_s(process) > idle_s:
                os.killpg(process, signal.SIGXCPU)
            time.sleep(0.02)
            ended, status = os.waitpid(process, os.WNOHANG)
        if answer.is_file():
            return dict(json.loads(answer.read_text(encoding="utf-8")))
        is_timeout = os.WIFSIGNALED(status) and os.WTERMSIG(status) == signal.SIGXCPU
        test = "" if is_timeout else f"pytest ended with status {status}"
        outcome = "timeout" if is_timeout else "failed"
        return {"outcome": outcome, "test": test, "seconds": cpu_s, "waited_s": 0.0}


def _scheduled_s(process: int) -> float:
    """Return the time in which a process ran or waited for a processor."""
    running_ns, waiting_ns, _ = Path(f"/proc/{process}/schedstat").read_text(encoding="ascii").split()
    return (int(running_ns) + int(waiting_ns)) * 1e-9


def _run_in_fork(arguments: list[str], answer: Path, cpu_s: int) -> None:
    """Run pytest in this process, write the answer and end the process."""
    os.setpgrp()  # not a new session, which would have a scheduling group and priority of its own
    started = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(started) + cpu_s, int(started) + cpu_s + 5))
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    failure = _FirstFailure()
    code = pytest.main([*_OPTIONS, *arguments], plugins=[failure])
    passed = code in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
    result = {
        "outcome": "passed" if passed else "failed",
        "test": "" if passed else failure.test or f"pytest ended with {int(code)}",
        "seconds": round(time.process_time() - started, 2),
        "waited_s": round(failure.waited_s, 2),
    }
    answer.with_suffix(".part").write_text(json.dumps(result), encoding="utf-8")
    answer.with_suffix(".part").replace(answer)
    os._exit(0)


if __name__ == "__main__":
    main()

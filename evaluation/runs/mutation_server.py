# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Process that runs tests in forks of itself, so that libraries are imported only once.

Each line of standard input is a JSON object with ``arguments`` of pytest, ``cpu_s`` and ``wall_s`` (limits).
Each line of standard output is the result: ``outcome`` (passed, failed or timeout), ``test`` (the first that
failed) and ``seconds`` (CPU).
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
    "-m", "not slow and not soak and not integration and not e2e",
]  # fmt: skip


class _FirstFailure:
    """pytest plug-in."""

    test = ""

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        self._note(report)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._note(report)

    def _note(self, report: pytest.CollectReport | pytest.TestReport) -> None:
        if report.failed and not self.test:
            self.test = report.nodeid


def main() -> None:
    """Answer requests until the input ends."""
    for library in _LIBRARIES:
        importlib.import_module(library)
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_run(**json.loads(line))) + "\n")
        sys.stdout.flush()


def _run(arguments: list[str], cpu_s: int, wall_s: float) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        answer = Path(folder) / "answer.json"
        process = os.fork()
        if process == 0:
            _run_in_fork([*arguments, f"--basetemp={folder}/pytest"], answer, cpu_s)
        deadline = time.monotonic() + wall_s
        while os.waitpid(process, os.WNOHANG)[0] == 0:
            if time.monotonic() > deadline:
                os.killpg(process, signal.SIGKILL)
                os.waitpid(process, 0)
                break
            time.sleep(0.02)
        if not answer.is_file():
            return {"outcome": "timeout", "test": "", "seconds": cpu_s}
        return dict(json.loads(answer.read_text(encoding="utf-8")))


def _run_in_fork(arguments: list[str], answer: Path, cpu_s: int) -> None:
    """Run pytest in this process, write the answer and end the process."""
    os.setsid()
    started = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(started) + cpu_s, int(started) + cpu_s))
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
    }
    answer.with_suffix(".part").write_text(json.dumps(result), encoding="utf-8")
    answer.with_suffix(".part").replace(answer)
    os._exit(0)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Process that runs tests in forks of itself, so that libraries are imported only once.

Each line of standard input is a JSON object with ``arguments`` of pytest, ``cpu_s`` and ``wall_s`` (limits),
and ``trace`` (whether the functions called by each test are recorded). Each line of standard output is the
result: ``outcome`` (passed, failed or timeout), ``test`` (the first failed one), ``seconds`` (CPU) and
``tests`` (duration and called functions of each passed test, if traced).
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
from collections.abc import Generator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

#: Packages whose functions are recorded.
PACKAGES = ("cdff_common", "cdff_core", "dpm_store", "services")
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


class _Results:
    """pytest plug-in: the first failure, and for each test the functions that it called."""

    def __init__(self, root: str, trace: bool) -> None:
        self._root, self._trace = root, trace
        self._codes: set[CodeType] = set()
        self.failed = ""
        self.tests: dict[str, dict[str, Any]] = {}

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed:
            self.failed = self.failed or report.nodeid
            self.tests.pop(report.nodeid, None)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Generator[None, object, object]:
        self._codes.clear()
        started = time.process_time()
        if self._trace:
            sys.settrace(self._record)
        self.tests[item.nodeid] = {}
        result = yield
        sys.settrace(None)
        if item.nodeid in self.tests:
            self.tests[item.nodeid] = {
                "seconds": round(time.process_time() - started, 3),
                "functions": sorted({name for code in self._codes if (name := self._name(code))}),
            }
        return result

    def _record(self, frame: FrameType, event: str, argument: object) -> None:
        self._codes.add(frame.f_code)

    def _name(self, code: CodeType) -> str:
        if not code.co_filename.startswith(tuple(f"{self._root}{package}/" for package in PACKAGES)):
            return ""
        names = [n for n in code.co_qualname.split(".") if not n.startswith("<")]
        return f"{code.co_filename[len(self._root) :]}::{'.'.join(names)}"


def main() -> None:
    """Answer requests until the input ends."""
    for library in _LIBRARIES:
        importlib.import_module(library)
    for line in sys.stdin:
        sys.stdout.write(json.dumps(_run(**json.loads(line))) + "\n")
        sys.stdout.flush()


def _run(arguments: list[str], cpu_s: int, wall_s: float, trace: bool) -> dict[str, Any]:
    with tempfile.TemporaryDirectory(prefix="mutant-") as folder:
        answer = Path(folder) / "answer.json"
        process = os.fork()
        if process == 0:
            _run_in_fork([*arguments, f"--basetemp={folder}/pytest"], answer, cpu_s, trace)
        deadline = time.monotonic() + wall_s
        while os.waitpid(process, os.WNOHANG)[0] == 0:
            if time.monotonic() > deadline:
                os.killpg(process, signal.SIGKILL)
                os.waitpid(process, 0)
                break
            time.sleep(0.02)
        if not answer.is_file():
            return {"outcome": "timeout", "test": "", "seconds": cpu_s, "tests": {}}
        return dict(json.loads(answer.read_text(encoding="utf-8")))


def _run_in_fork(arguments: list[str], answer: Path, cpu_s: int, trace: bool) -> None:
    """Run pytest in this process, write the answer and end the process."""
    os.setsid()
    if not trace:  # compiled files must not outlive a changed source
        sys.dont_write_bytecode = True
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"
    started = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (int(started) + cpu_s, int(started) + cpu_s))
    with Path(os.devnull).open("w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    results = _Results(f"{Path.cwd()}/", trace)
    options = [option for option in _OPTIONS if not (trace and option == "-x")]
    code = pytest.main([*options, *arguments], plugins=[results])
    passed = code == pytest.ExitCode.OK
    text = json.dumps(
        {
            "outcome": "passed" if passed else "failed",
            "test": "" if passed else results.failed or f"pytest ended with {int(code)}",
            "seconds": round(time.process_time() - started, 2),
            "tests": results.tests if trace else {},
        }
    )
    answer.with_suffix(".part").write_text(text, encoding="utf-8")
    answer.with_suffix(".part").replace(answer)
    os._exit(0)


if __name__ == "__main__":
    main()

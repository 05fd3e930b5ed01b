# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the tests of a mutant in a temporary copy of the tree."""

from __future__ import annotations

import json
import math
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cdff_common.errors import InputError
from evaluation.runs.mutants import Mutant
from evaluation.runs.nearest_tests import NearestTests

#: Limit of the CPU time of one group, seconds, and relative to its CPU time without the change: shared caches
#: and processors make the same work up to twice as long.
LIMIT_S, LIMIT_FACTOR = 45, 3
#: Limit of the time in which the main thread waits for something else than a processor, seconds.
_IDLE_S = 300
#: A test that failed after it waited for longer may have missed a deadline and is repeated, seconds.
_LEAST_WAIT_S = 0.5
#: Number of tests that run together on the unchanged tree, and of their runs of which one has to pass.
_BATCH, _ATTEMPTS = 20, 3
_NOT_COPIED = shutil.ignore_patterns(".git", ".venv", "build", "node_modules", ".*_cache")
_THREADS = {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL", "NUMBA")}


class MutationTests:
    """Copy of the tree with a process that runs its tests.

    Parameters
    ----------
    root : Path
        The tree, which is not changed.
    """

    def __init__(self, root: Path) -> None:
        self._folder = tempfile.TemporaryDirectory(prefix="mutation-")
        self._tree = Path(self._folder.name) / "tree"
        shutil.copytree(root, self._tree, ignore=_NOT_COPIED, symlinks=True)
        if (root / ".venv").exists():
            (self._tree / ".venv").symlink_to((root / ".venv").resolve())
        environment = os.environ | _THREADS | {"PYTHONPATH": str(self._tree)}
        environment.setdefault("CDFF_DATA", str(root.parent / "shared" / "data"))
        self._server = subprocess.Popen(
            [sys.executable, "-m", "evaluation.runs.mutation_server"],
            cwd=self._tree, env=environment, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip
        self._nearest = NearestTests(self._tree)
        self._limit_s: dict[tuple[str, ...], int] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._server.stdin is not None
        self._server.stdin.close()
        self._server.wait()
        self._folder.cleanup()

    def run(self, mutant: Mutant) -> dict[str, str]:
        """Return the outcome of a mutant (killed, timeout or survived) and the first test that failed.

        The outcome does not depend on the load of the machine: the limit is one of CPU time, and a test that
        may have missed a deadline kills the mutant only if it fails twice.
        """
        for group in self._nearest.groups(mutant.path, mutant.function):
            with self._change(mutant):
                answer = self._run(group)
                if answer["outcome"] == "failed" and answer["waited_s"] > _LEAST_WAIT_S:
                    answer = self._run((answer["test"], *group))
            if answer["outcome"] == "timeout":
                answer = self._run_longer(mutant, group)
            if answer["outcome"] == "failed":
                return {"outcome": "killed", "test": answer["test"]}
            if answer["outcome"] == "timeout":
                return {"outcome": "timeout", "test": ""}
        return {"outcome": "survived", "test": ""}

    def check_without_change(self, tests: Iterable[str]) -> None:
        """Raise InputError if one of the tests that killed mutants fails on the unchanged tree."""
        selected = sorted({test for test in tests if "::" in test})
        for start in range(0, len(selected), _BATCH):
            for _ in range(_ATTEMPTS):
                arguments = (*selected[start : start + _BATCH], "-m", "")
                answer = self._run(arguments, cpu_s=LIMIT_FACTOR * _BATCH * LIMIT_S)
                if answer["outcome"] == "passed":
                    break
            else:
                raise InputError(f"{answer['test']}: {answer['outcome']} without a change, expected to pass")

    def _run_longer(self, mutant: Mutant, group: tuple[str, ...]) -> dict[str, Any]:
        """Repeat a run that exceeded its limit, with a limit that the tests do not exceed on unchanged
        code.
        """
        if group not in self._limit_s:
            unchanged = self._run(group, cpu_s=LIMIT_FACTOR * LIMIT_S)
            passed = unchanged["outcome"] == "passed"
            self._limit_s[group] = math.ceil(LIMIT_FACTOR * unchanged["seconds"]) if passed else 0
        if self._limit_s[group] == 0:
            return {"outcome": "passed"}  # too slow a group to notice any change
        if self._limit_s[group] <= LIMIT_S:
            return {"outcome": "timeout"}
        with self._change(mutant):
            return self._run(group, cpu_s=self._limit_s[group])

    @contextmanager
    def _change(self, mutant: Mutant) -> Iterator[None]:
        file = self._tree / mutant.path
        compiled = {cached: cached.read_bytes() for cached in self._compiled(mutant.path)}
        for cached in compiled:
            cached.unlink()
        source, times = file.read_bytes(), file.stat()
        file.write_bytes(mutant.applied(source))
        try:
            yield
        finally:
            file.write_bytes(source)
            os.utime(file, ns=(times.st_atime_ns, times.st_mtime_ns))
            for cached in self._compiled(mutant.path):
                cached.unlink()
            for cached, content in compiled.items():
                cached.write_bytes(content)

    def _compiled(self, path: str) -> list[Path]:
        """Return the bytecode of a file and the functions compiled from it and from files that import it.

        numba compares the time of a function's own file only.
        """
        kernels = [path, *self._nearest.importers_with_kernels(path)]
        patterns = [(path, "pyc"), *[(file, "nb[ic]") for file in kernels]]
        return [
            cached
            for file, suffix in patterns
            for cached in (self._tree / file).parent.glob(f"__pycache__/{Path(file).stem}.*.{suffix}")
        ]

    def _run(self, arguments: tuple[str, ...], cpu_s: int = LIMIT_S) -> dict[str, Any]:
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        request = {"arguments": arguments, "cpu_s": cpu_s, "idle_s": _IDLE_S}
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        return dict(json.loads(self._server.stdout.readline()))

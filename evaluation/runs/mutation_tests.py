# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the tests of a mutant in a temporary copy of the tree."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from cdff_common.errors import InputError
from evaluation.runs.mutants import Mutant
from evaluation.runs.nearest_tests import NearestTests

#: Numbers of test files that are run one group after the other, nearest first.
GROUPS = (2, 6)
#: Limit of the CPU time of one group, seconds.
LIMIT_S = 45
#: Limit of the elapsed time relative to that of the CPU time, on a machine that others use too.
_ELAPSED_FACTOR = 10
_NOT_COPIED = shutil.ignore_patterns(".git", ".venv", "build", "node_modules", ".*_cache", "*.svg", "*.jpg")
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
        self._in_time: dict[tuple[str, ...], bool] = {}

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

        A run beyond the time limit counts as timeout only if the same tests keep it without the change.
        """
        ranked = self._nearest.ranked(mutant.path, mutant.function)
        start = 0
        for size in GROUPS:
            group = tuple(ranked[start : start + size])
            start += size
            if not group:
                break
            answer = self._run_changed(mutant, group)
            if answer["outcome"] == "failed":
                return {"outcome": "killed", "test": answer["test"]}
            if answer["outcome"] == "timeout" and self._is_in_time(group):
                return {"outcome": "timeout", "test": ""}
        return {"outcome": "survived", "test": ""}

    def check_without_change(self, tests: Iterable[str]) -> None:
        """Raise InputError if one of the tests that killed mutants fails on the unchanged tree."""
        selected = tuple(sorted({test for test in tests if "::" in test}))
        answer = self._run(selected, cpu_s=60 * LIMIT_S) if selected else {"outcome": "passed"}
        if answer["outcome"] != "passed":
            raise InputError(f"{answer['test']}: {answer['outcome']} without a change, expected to pass")

    def _is_in_time(self, group: tuple[str, ...]) -> bool:
        if group not in self._in_time:
            self._in_time[group] = self._run(group)["outcome"] == "passed"
        return self._in_time[group]

    def _run_changed(self, mutant: Mutant, group: tuple[str, ...]) -> dict[str, Any]:
        file = self._tree / mutant.path
        compiled = {cached: cached.read_bytes() for cached in self._compiled(mutant.path)}
        for cached in compiled:
            cached.unlink()
        source, times = file.read_bytes(), file.stat()
        file.write_bytes(mutant.applied(source))
        try:
            return self._run(group)
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
        request = {"arguments": arguments, "cpu_s": cpu_s, "wall_s": _ELAPSED_FACTOR * cpu_s}
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        return dict(json.loads(self._server.stdout.readline()))

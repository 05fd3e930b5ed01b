# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run the tests of a mutant in a temporary copy of the tree."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import Any, Self

from evaluation.runs.mutants import Mutant

#: Tests that are run; the files of a folder are traced in one process.
TEST_FOLDERS = (
    "tests/unit/services/orchestrator", "tests/unit/services/dpm", "tests/unit/dpm_store",
    "tests/unit/cdff_common/geometry", "tests/unit/cdff_core/orchestration", "tests/unit/cdff_core/dfns",
    "tests/unit/cdff_core/dfpcs", "tests/unit/cdff_core/imaging", "tests/unit/cdff_core/elevation",
    "tests/unit/cdff_core/map_merging", "tests/unit/cdff_core/partial_views", "tests/unit/cdff_core/runtime",
)  # fmt: skip
#: CPU time of the tests selected for a mutant, and limit of one run, seconds.
SELECTED_S, LIMIT_S = 30.0, 120
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
        self._root = root
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
        self._tests: dict[str, dict[str, Any]] = {}

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._server.stdin is not None
        self._server.stdin.close()
        self._server.wait()
        self._folder.cleanup()

    def trace(self, progress: Callable[[str], None]) -> None:
        """Run the tests without a change and record the functions that each of them calls.

        Files of tests that have not changed since an earlier trace are not run again.
        """
        cache = self._root / "build" / "mutation_trace.json"
        known = json.loads(cache.read_text(encoding="utf-8")) if cache.is_file() else {}
        for folder in TEST_FOLDERS:
            files = {str(f.relative_to(self._tree)): f for f in (self._tree / folder).rglob("test_*.py")}
            hashes = {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files.items()}
            missing = sorted(n for n, value in hashes.items() if known.get(n, {}).get("sha256") != value)
            progress(f"mutation: {len(missing)} files of {folder} without a change")
            traced = self._run(missing, cpu_s=3600, trace=True)["tests"] if missing else {}
            for name in missing:
                tests = {t: row for t, row in traced.items() if t.split("::")[0] == name and row}
                known[name] = {"sha256": hashes[name], "tests": tests}
            cache.parent.mkdir(exist_ok=True)
            cache.write_text(json.dumps(known), encoding="utf-8")
            self._tests |= {t: row for name in files for t, row in known[name]["tests"].items()}

    def run(self, mutant: Mutant) -> dict[str, Any]:
        """Return outcome, first failed test, CPU time and number of the selected tests of a mutant."""
        selected = self.selected(mutant)
        if not selected:
            return {"outcome": "passed", "test": "", "seconds": 0.0, "selected": 0}
        file = self._tree / mutant.path
        changed = mutant.applied(file.read_bytes())
        kernels = {cached: cached.read_bytes() for cached in self._stale_kernels(mutant.path)}
        for cached in kernels:
            cached.unlink()
        file.write_bytes(changed)
        try:
            answer = self._run(selected, LIMIT_S, trace=False)
        finally:
            shutil.copy2(self._root / mutant.path, file)
            for cached in self._stale_kernels(mutant.path):
                cached.unlink()
            for cached, compiled in kernels.items():
                cached.write_bytes(compiled)
        return {key: answer[key] for key in ("outcome", "test", "seconds")} | {"selected": len(selected)}

    def selected(self, mutant: Mutant) -> list[str]:
        """Return the tests that call the mutant's function, else those that use its file, nearest first.

        Compiled functions are called unseen: tests that use their file or a file that imports it are taken.
        """
        function = f"{mutant.path}::{mutant.function}"
        called = {t for t, row in self._tests.items() if mutant.function and function in row["functions"]}
        files = {mutant.path}
        for _ in range(3):
            if called:
                break
            called = {
                t for t, row in self._tests.items() if files & {f.split("::")[0] for f in row["functions"]}
            }
            files |= {importer for file in files for importer in self._importers(file)}
        ranked = sorted(called, key=lambda t: (-_shared_folders(t, mutant.path), self._tests[t]["seconds"]))
        total, selected = 0.0, []
        for test in ranked:
            total += self._tests[test]["seconds"]
            if selected and total > SELECTED_S:
                break
            selected.append(test)
        return selected

    def _importers(self, path: str) -> set[str]:
        """Return the files that import a file by its module's name."""
        module = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
        package, _, name = module.rpartition(".")
        pattern = re.compile(
            rf"^\s*(from {re.escape(module)} import |import {re.escape(module)}\b"
            rf"|from {re.escape(package)} import .*\b{re.escape(name)}\b)",
            re.MULTILINE,
        )
        return {
            str(file.relative_to(self._tree))
            for folder in ("cdff_common", "cdff_core", "dpm_store", "services")
            for file in (self._tree / folder).rglob("*.py")
            if pattern.search(file.read_text(encoding="utf-8"))
        }

    def _stale_kernels(self, path: str) -> list[Path]:
        """Return the compiled functions of the files that import a changed file; numba checks only their own.

        The chain of imports is followed through files that contain compiled functions.
        """
        reached, waiting = set[str](), [path]
        while waiting:
            for importer in self._importers(waiting.pop()) - reached:
                if "njit" in (self._tree / importer).read_text(encoding="utf-8"):
                    reached.add(importer)
                    waiting.append(importer)
        return [
            cached
            for file in (PurePosixPath(p) for p in {path, *reached})
            for cached in (self._tree / file.parent / "__pycache__").glob(f"{file.stem}.*.nb[ic]")
        ]

    def _run(self, arguments: list[str], cpu_s: int, trace: bool) -> dict[str, Any]:
        assert self._server.stdin is not None
        assert self._server.stdout is not None
        request = {"arguments": arguments, "cpu_s": cpu_s, "wall_s": _ELAPSED_FACTOR * cpu_s, "trace": trace}
        self._server.stdin.write(json.dumps(request) + "\n")
        self._server.stdin.flush()
        return dict(json.loads(self._server.stdout.readline()))


def _shared_folders(test: str, path: str) -> int:
    """Return how many folders of a test's mirrored place are those of a file, with one more for its name."""
    mirrored = PurePosixPath(test.split("::")[0]).relative_to("tests/unit")
    file = PurePosixPath(path)
    pairs = zip(mirrored.parent.parts, file.parent.parts, strict=False)
    shared = next(
        (i for i, (a, b) in enumerate(pairs) if a != b), min(len(mirrored.parts), len(file.parts)) - 1
    )
    return shared + (mirrored.name == f"test_{file.name}")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the test files that are most likely to notice a change of a function."""

from __future__ import annotations

import itertools
import math
import re
from collections import Counter
from functools import cache
from pathlib import Path, PurePosixPath

_PACKAGES = ("cdff_common", "cdff_core", "dpm_store", "services")
#: Weights of a test file with an import of the file, of the same name, in the mirrored folder, in one above,
#: and in the mirrored folder of a file that imports it. A name of class, function or module in the text
#: counts the more, the more often it occurs and the fewer test files have it.
_IMPORT, _SAME_NAME, _SAME_FOLDER, _FOLDER_ABOVE, _IMPORTER_FOLDER = 6, 4, 4, 2, 4
#: Logarithm of the ratio of all test files to those with a name, below which it is too common.
_LEAST_RARITY = 1.5
#: Number of imports between a file and one that counts as using it.
_IMPORT_LEVELS = 2
#: Slow test that the reference pages state the defaults and bounds of the parameters of DFNs and DFPCs.
_PARAMETERS = (
    "tests/contract/test_generated.py::test_generated_files_are_up_to_date[reference]",
    "-m",
    "slow",
)
#: Numbers of test files that run together, nearest first.
_GROUPS = (2, 6)


class NearestTests:
    """Test files of a tree, ranked for a file and function by names, folders and imports."""

    def __init__(self, root: Path) -> None:
        tests = [
            *(root / "tests" / "unit").rglob("test_*.py"),
            *(root / "tests" / "contract").glob("test_*.py"),
        ]
        self._tests = {str(file.relative_to(root)): _words_and_text(file) for file in tests}
        sources = [file for package in _PACKAGES for file in (root / package).rglob("*.py")]
        self._sources = {str(file.relative_to(root)): file.read_text(encoding="utf-8") for file in sources}
        self._importers: dict[str, set[str]] = {}

    def groups(self, path: str, function: str) -> list[tuple[str, ...]]:
        """Return the arguments of pytest for the tests of a function, one group to run after the other."""
        ranked = self._ranked(path, function)
        ends = list(itertools.accumulate(_GROUPS, initial=0))
        groups = [tuple(ranked[start:end]) for start, end in itertools.pairwise(ends)]
        has_parameters = not function and path.startswith("cdff_core/df")
        return [_PARAMETERS, *groups] if has_parameters else groups

    def _ranked(self, path: str, function: str) -> list[str]:
        """Return all test files, those that are nearest to a function of a file first."""
        file = PurePosixPath(path)
        names = {file.stem, *file.stem.split("_"), *function.split(".")}
        if path.startswith("cdff_core/df"):
            names.add(file.parent.name)
        folders = self._folders_of_importers(path)
        pattern = _import_of(path)
        scores = {}
        for test, (words, text) in self._tests.items():
            mirrored = PurePosixPath(*PurePosixPath(test).parts[2:])
            score = _IMPORT * bool(pattern.search(text))
            score += sum((1 + math.log(words[name])) * self._rarity(name) for name in names & words.keys())
            if mirrored.parent == file.parent:
                score += _SAME_FOLDER + _SAME_NAME * (mirrored.name == f"test_{file.name}")
            elif mirrored.parent in list(file.parents)[:2]:
                score += _FOLDER_ABOVE
            elif mirrored.parent in folders:
                score += _IMPORTER_FOLDER
            scores[test] = score
        return sorted(scores, key=lambda t: (-scores[t], len(self._tests[t][1]), t))

    def _folders_of_importers(self, path: str) -> set[PurePosixPath]:
        files = {path}
        for _ in range(_IMPORT_LEVELS):
            files |= {importer for file in files for importer in self.importers(file)}
        return {PurePosixPath(file).parent for file in files}

    def _rarity(self, name: str) -> float:
        count = sum(name in words for words, _ in self._tests.values())
        rarity = math.log(len(self._tests) / count)
        return rarity if rarity > _LEAST_RARITY else 0.0

    def importers(self, path: str) -> set[str]:
        """Return the files that import a file by its module's name."""
        if path not in self._importers:
            pattern = _import_of(path)
            self._importers[path] = {name for name, text in self._sources.items() if pattern.search(text)}
        return self._importers[path]

    def importers_with_kernels(self, path: str) -> set[str]:
        """Return the files with compiled functions that import a file, directly or through such files."""
        reached, waiting = set[str](), [path]
        while waiting:
            for importer in self.importers(waiting.pop()) - reached:
                if "njit" in self._sources[importer]:
                    reached.add(importer)
                    waiting.append(importer)
        return reached


def _words_and_text(file: Path) -> tuple[Counter[str], str]:
    text = file.read_text(encoding="utf-8")
    return Counter(re.findall(r"\w+", text)), text


@cache
def _import_of(path: str) -> re.Pattern[str]:
    module = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    package, _, name = module.rpartition(".")
    return re.compile(
        rf"^\s*(from {re.escape(module)} import |import {re.escape(module)}\b"
        rf"|from {re.escape(package)} import .*\b{re.escape(name)}\b)",
        re.MULTILINE,
    )

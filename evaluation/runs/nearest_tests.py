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

from evaluation.runs.import_graph import ImportGraph

_PACKAGES = ("cdff_common", "cdff_core", "dpm_store", "services")
#: Folders whose files connect tests with the code that they execute.
_CONNECTING = ("cdff_dev", "evaluation", "tests/support")
#: Weights of a test file with an import of the file (less through others), of the same name and in the
#: mirrored folder. A name of class, function or module in the text counts the more, the more often it occurs,
#: the fewer test files have it and the nearer the test is; parts of the module's name count less. Tests of a
#: lower score run only if there are few others.
_IMPORT, _SAME_NAME, _SAME_FOLDER, _FOLDER_ABOVE = 8, 4, 4, 2
_UNREACHED, _PART_OF_NAME, _LEAST_SCORE = 0.1, 0.25, 0.5
#: Logarithm of the ratio of all test files to those with a name, below which it is too common.
_LEAST_RARITY = 1.5
#: Slow test that the reference pages state the defaults and bounds of the parameters of DFNs and DFPCs.
_PARAMETERS = (
    "tests/contract/test_generated.py::test_generated_files_are_up_to_date[reference]",
    "-m",
    "slow",
)
#: Numbers of test files that run together, nearest first.
_GROUPS = (2, 6, 6, 6)
#: Number of the nearest test files of which the slow tests run last.
_SLOW_FILES = 2
_SLOW = ("-m", "slow and not soak and not integration and not e2e")


class NearestTests:
    """Test files of a tree, ranked for a file and function by names, folders and imports."""

    def __init__(self, root: Path) -> None:
        tests = [
            *(root / "tests" / "unit").rglob("test_*.py"),
            *(root / "tests" / "contract").glob("test_*.py"),
            *(root / "tests" / "golden").glob("test_*.py"),
        ]
        self._tests = {str(file.relative_to(root)): _words_and_text(file) for file in tests}
        sources = [file for package in _PACKAGES for file in (root / package).rglob("*.py")]
        self._sources = {str(file.relative_to(root)): file.read_text(encoding="utf-8") for file in sources}
        self._importers: dict[str, set[str]] = {}
        connecting = [file for folder in _CONNECTING for file in (root / folder).rglob("*.py")]
        plans = (root / "cdff_core" / "dfpcs").rglob("dfpc.yaml")
        texts = {str(f.relative_to(root)): f.read_text(encoding="utf-8") for f in (*connecting, *plans)}
        self._graph = ImportGraph(
            texts | self._sources | {test: text for test, (_, text) in self._tests.items()}
        )
        self._steps_to = cache(self._graph.steps_to)

    def groups(self, path: str, function: str) -> list[tuple[str, ...]]:
        """Return the arguments of pytest for the tests of a function, one group to run after the other."""
        ranked = self._ranked(path, function)
        ends = list(itertools.accumulate(_GROUPS, initial=0))
        groups = [tuple(ranked[start:end]) for start, end in itertools.pairwise(ends) if ranked[start:end]]
        if slow := tuple(test for test in ranked[:_SLOW_FILES] if _has_slow_tests(self._tests[test][1])):
            groups.append((*slow, *_SLOW))
        has_parameters = not function and path.startswith("cdff_core/df")
        return [_PARAMETERS, *groups] if has_parameters else groups

    def _ranked(self, path: str, function: str) -> list[str]:
        """Return the test files that are near to a function of a file, the nearest first."""
        file = PurePosixPath(path)
        names = dict.fromkeys(file.stem.split("_"), _PART_OF_NAME)
        names |= dict.fromkeys((file.stem, *function.split(".")), 1.0)
        if path.startswith("cdff_core/df"):
            names[file.parent.name] = 1.0
        steps = self._steps_to(path)
        scores = {}
        for test, (words, _) in self._tests.items():
            mirrored = PurePosixPath(*PurePosixPath(test).parts[2:])
            score = sum(
                weight * (1 + math.log(words[name])) * self._rarity(name)
                for name, weight in names.items()
                if name in words
            )
            if test not in steps:
                scores[test] = _UNREACHED * score
                continue
            score = (score + _IMPORT) / steps[test]
            if mirrored.parent == file.parent:
                score += _SAME_FOLDER + _SAME_NAME * (mirrored.name == f"test_{file.name}")
            elif mirrored.parent in list(file.parents)[:2]:
                score += _FOLDER_ABOVE
            scores[test] = score
        ranked = sorted(scores, key=lambda t: (-scores[t], len(self._tests[t][1]), t))
        least = sum(_GROUPS[:2])
        return ranked[:least] + [test for test in ranked[least:] if scores[test] >= _LEAST_SCORE]

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


def _has_slow_tests(text: str) -> bool:
    return "pytest.mark.slow" in text


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

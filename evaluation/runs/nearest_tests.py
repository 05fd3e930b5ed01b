# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Selection of the test files that are most likely to notice a change of a function."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path, PurePosixPath

_PACKAGES = ("cdff_common", "cdff_core", "dpm_store", "services")
#: Weights of a test file: of the same name, in the mirrored folder, with an import of the file, in the
#: mirrored folder of a file that imports it, and for each name of class, function and module in its text.
_SAME_NAME, _SAME_FOLDER, _IMPORT, _IMPORTER_FOLDER, _WORD = 3, 3, 4, 2, 1


#: Test that the reference pages state the defaults and bounds of the parameters of DFNs and DFPCs.
_PARAMETERS = "tests/contract/test_generated.py::test_generated_files_are_up_to_date[reference]"


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

    def ranked(self, path: str, function: str) -> list[str]:
        """Return the test files that have something in common with a function of a file, nearest first."""
        file = PurePosixPath(path)
        names = {file.stem, *function.split(".")} - {"", "__init__", "__post_init__"}
        if path.startswith("cdff_core/df"):
            names.add(file.parent.name)
        folders = {str(PurePosixPath(importer).parent) for importer in self.importers(path)}
        pattern = _import_of(path)
        scores = {}
        for test, (words, text) in self._tests.items():
            mirrored = PurePosixPath(test).relative_to("tests").relative_to(PurePosixPath(test).parts[1])
            folder = str(mirrored.parent)
            score = _WORD * len(names & words) + _IMPORT * bool(pattern.search(text))
            score += _SAME_NAME * (mirrored.name == f"test_{file.name}")
            if folder == str(file.parent):
                score += _SAME_FOLDER
            elif folder in folders:
                score += _IMPORTER_FOLDER
            if score:
                scores[test] = score
        nearest = sorted(scores, key=lambda t: (-scores[t], len(self._tests[t][1]), t))
        return nearest if function or not path.startswith("cdff_core/df") else [_PARAMETERS, *nearest]

    def importers(self, path: str) -> set[str]:
        """Return the files that import a file by its module's name."""
        pattern = _import_of(path)
        return {source for source, text in self._sources.items() if pattern.search(text)}

    def importers_with_kernels(self, path: str) -> set[str]:
        """Return the files with compiled functions that import a file, directly or through such files."""
        reached, waiting = set[str](), [path]
        while waiting:
            for importer in self.importers(waiting.pop()) - reached:
                if "njit" in self._sources[importer]:
                    reached.add(importer)
                    waiting.append(importer)
        return reached


def _words_and_text(file: Path) -> tuple[set[str], str]:
    text = file.read_text(encoding="utf-8")
    return set(re.findall(r"\w+", text)), text


@cache
def _import_of(path: str) -> re.Pattern[str]:
    module = path.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    package, _, name = module.rpartition(".")
    return re.compile(
        rf"^\s*(from {re.escape(module)} import |import {re.escape(module)}\b"
        rf"|from {re.escape(package)} import .*\b{re.escape(name)}\b)",
        re.MULTILINE,
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outcomes of mutants from earlier runs of the mutation test that are still valid for the committed tree."""

from __future__ import annotations

import json
import subprocess
from functools import cache
from pathlib import Path

from evaluation.record import provenance

#: Folders of which each change can change any answer.
_SOURCES = (
    "cdff_common",
    "cdff_core",
    "cdff_dev",
    "dpm_store",
    "services",
    "tests/conftest.py",
    "tests/support",
)
#: Folders of which a change can change the answer for a survivor.
_TESTS = ("tests", "evaluation")


class MutationProgress:
    """Outcomes by ``Mutant.key``, each with the git objects of the files that it depends on.

    The outcome of a killed mutant holds as long as the sources and the file of the test that killed it are
    the same, any other outcome as long as all tests and their selection are the same. With uncommitted
    changes nothing is read or written.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._path = root / "build" / "mutation.json"
        origin = provenance(root)
        self._commit, self._is_committed = origin["commit"], not origin["tree_differs"]
        self._answers: dict[str, dict[str, str]] = {}
        if self._is_committed and self._path.is_file():
            self._answers = json.loads(self._path.read_text(encoding="utf-8"))
        self._object = cache(self._object_of)

    def answer(self, key: str) -> dict[str, str] | None:
        """Return the outcome and the test of a mutant, None if it has to run."""
        known = self._answers.get(key)
        if known is None or known["depends_on"] != self._dependencies(known):
            return None
        return {name: known[name] for name in ("outcome", "test")}

    def add(self, key: str, answer: dict[str, str]) -> dict[str, str]:
        """Store and return the outcome and the test of a mutant."""
        self._answers[key] = answer | {"depends_on": self._dependencies(answer)}
        if self._is_committed:
            self._path.parent.mkdir(exist_ok=True)
            self._path.write_text(json.dumps(self._answers, indent=1) + "\n", encoding="utf-8")
        return answer

    def _dependencies(self, answer: dict[str, str]) -> str:
        is_killed = answer["outcome"] == "killed" and answer["test"].startswith("tests/")
        tests = (answer["test"].split("::")[0],) if is_killed else _TESTS
        return " ".join(self._object(path)[:12] for path in (*_SOURCES, *tests))

    def _object_of(self, path: str) -> str:
        command = ["git", "rev-parse", f"{self._commit}:{path}"]
        return subprocess.run(
            command, cwd=self._root, capture_output=True, text=True, check=True
        ).stdout.strip()

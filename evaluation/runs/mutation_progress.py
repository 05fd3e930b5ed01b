# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Outcomes of mutants from earlier runs and records that are still valid for the committed tree."""

from __future__ import annotations

import json
import subprocess
from functools import cache
from pathlib import Path

from evaluation.record import provenance

#: Files and folders of which a change can change the answer for a survivor.
_TREE = (
    "cdff_common",
    "cdff_core",
    "cdff_dev",
    "dpm_store",
    "services",
    "evaluation",
    "tests",
)
#: The record, whose killed mutants need not run again.
_RECORD = "docs/evaluation/mutation.json"


class MutationProgress:
    """Outcomes by ``Mutant.key``, each with the git objects of the files that it depends on.

    The outcome of a killed mutant holds as long as its file and the file of the test that killed it are the
    same, any other outcome as long as the sources, all tests and their selection are the same. With
    uncommitted changes nothing is read or written.
    """

    def __init__(self, root: Path) -> None:
        self._root = root
        self._path = root / "build" / "mutation.json"
        origin = provenance(root)
        self._commit, self._is_committed = origin["commit"], not origin["tree_differs"]
        self._answers: dict[str, dict[str, str]] = {}
        if self._is_committed:
            self._answers = self._recorded()
            if self._path.is_file():
                self._answers |= json.loads(self._path.read_text(encoding="utf-8"))
        self._object = cache(self._object_of)

    def answer(self, key: str) -> dict[str, str] | None:
        """Return outcome, test and dependencies of a mutant, None if it has to run."""
        known = self._answers.get(key)
        return known if known is not None and known["depends_on"] == self._dependencies(key, known) else None

    def add(self, key: str, answer: dict[str, str]) -> dict[str, str]:
        """Store and return outcome, test and dependencies of a mutant."""
        self._answers[key] = answer | {"depends_on": self._dependencies(key, answer)}
        if self._is_committed:
            self._path.parent.mkdir(exist_ok=True)
            self._path.write_text(json.dumps(self._answers, indent=1) + "\n", encoding="utf-8")
        return self._answers[key]

    def _recorded(self) -> dict[str, dict[str, str]]:
        """Return the outcomes of the record with their dependencies."""
        path = self._root / _RECORD
        rows = json.loads(path.read_text(encoding="utf-8"))["figures"]["mutants"] if path.is_file() else []
        names = ("outcome", "test", "depends_on")
        return {row["mutant"]: {name: row[name] for name in names} for row in rows if "depends_on" in row}

    def _dependencies(self, key: str, answer: dict[str, str]) -> str:
        is_killed = answer["outcome"] == "killed" and answer["test"].startswith("tests/")
        paths = (key.split("::")[0], answer["test"].split("::")[0]) if is_killed else _TREE
        return " ".join(self._object(path)[:12] for path in paths)

    def _object_of(self, path: str) -> str:
        """Return the git object of a file or folder, empty if there is none."""
        command = ["git", "rev-parse", "--verify", "--quiet", f"{self._commit}:{path}"]
        return subprocess.run(
            command, cwd=self._root, capture_output=True, text=True, check=False
        ).stdout.strip()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generated files: compared with the existing ones, shown as a diff, written.

A generated file is always overwritten and never edited; skeletons (implementation, test) are written once.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

MARK = "GENERATED from {source} by cdff generate; do not edit."


@dataclass(frozen=True, slots=True)
class Artefact:
    """A generated file.

    Attributes
    ----------
    path : Path
        Absolute.
    text : str
    once : bool
        Written only if the file does not exist.
    """

    path: Path
    text: str
    once: bool = False

    @property
    def is_due(self) -> bool:
        """True if writing the file would change the tree."""
        if not self.path.is_file():
            return True
        return not self.once and self.path.read_text(encoding="utf-8") != self.text

    def write(self) -> None:
        """Write the file."""
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(self.text, encoding="utf-8")

    def diff(self, root: Path) -> str:
        """Return the unified diff from the existing to the new text."""
        name = self.path.relative_to(root).as_posix()
        before = self.path.read_text(encoding="utf-8") if self.path.is_file() else ""
        return "".join(
            difflib.unified_diff(
                before.splitlines(keepends=True),
                self.text.splitlines(keepends=True),
                f"a/{name}",
                f"b/{name}",
            )
        )


def due(artefacts: Iterable[Artefact]) -> list[Artefact]:
    """Return those that differ from the tree, sorted by path."""
    return sorted((a for a in artefacts if a.is_due), key=lambda a: a.path)

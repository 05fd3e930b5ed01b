# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Generated files: comparison with the existing files, differences, writing.

A generated file is overwritten and must not be edited; a skeleton (implementation, test) is written once.
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
        Absolute path.
    text : str
        Content.
    once : bool
        If True, the file is written only if it does not exist.
    """

    path: Path
    text: str
    once: bool = False

    @property
    def is_due(self) -> bool:
        """True if the file does not exist or has another content, and is to be written."""
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
    """Return the artefacts that are to be written, sorted by path."""
    return sorted((a for a in artefacts if a.is_due), key=lambda a: a.path)

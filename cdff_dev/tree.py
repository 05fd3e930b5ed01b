# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Source tree: folders of descriptions, generated files and tests."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.description import (
    DfnDescription,
    DfpcDescription,
    read_dfn_description,
    read_dfpc_description,
)

DescriptionT = TypeVar("DescriptionT", DfnDescription, DfpcDescription)


@dataclass(frozen=True, slots=True)
class Tree:
    """A checkout of the repository.

    Attributes
    ----------
    root : Path
        The folder that holds ``pyproject.toml`` and ``cdff_core``.
    """

    root: Path

    @classmethod
    def here(cls) -> Tree:
        """Return the checkout that contains this code; raises ConfigurationError if there is none."""
        root = Path(__file__).resolve().parents[1]
        if not (root / "pyproject.toml").is_file():
            raise ConfigurationError(
                f"{root}: no pyproject.toml; files are generated only in a checkout, installed with pip -e"
            )
        return cls(root)

    def folder(self, kind: str, name: str) -> Path:
        """Return the folder of a DFN or DFPC; ``kind`` is ``dfn`` or ``dfpc``."""
        return self.root / "cdff_core" / f"{kind}s" / name

    def test_folder(self, kind: str, name: str) -> Path:
        """Return the folder of the unit tests of a DFN or DFPC."""
        return self.root / "tests" / "unit" / "cdff_core" / f"{kind}s" / name

    def dfns(self) -> Iterator[DfnDescription]:
        """Yield every DFN description, in order of folders; raises ConfigurationError on an invalid one."""
        for path in self._descriptions("dfn"):
            yield _check_folder(read_dfn_description(path), path)

    def dfpcs(self) -> Iterator[DfpcDescription]:
        """Yield every DFPC description, in order of folders; raises ConfigurationError on an invalid one."""
        for path in self._descriptions("dfpc"):
            yield _check_folder(read_dfpc_description(path), path)

    def _descriptions(self, kind: str) -> list[Path]:
        return sorted((self.root / "cdff_core" / f"{kind}s").glob(f"*/{kind}.yaml"))


def _check_folder(description: DescriptionT, path: Path) -> DescriptionT:
    """Return the description if its folder has its name; raises ConfigurationError otherwise."""
    if description.folder != path.parent.name:
        raise ConfigurationError(
            f"{path}: the name {description.name} belongs in folder {description.folder}"
        )
    return description

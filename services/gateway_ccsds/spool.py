# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on disk that wait for their transfer: a folder for each, with its files and a sidecar.

A folder appears complete, by its renaming. Each file is removed when the ground segment has received it, the
sidecar last, so that its arrival states that the product is complete. After a restart the remaining files are
sent.
"""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

_SIDECAR = ".json"
_BUILDING = ".part"


class Spool:
    """Waiting products of a folder, by priority and order of insertion.

    Parameters
    ----------
    folder : Path
    part_bytes : int
        Size from which on a payload is split into several files.
    """

    def __init__(self, folder: Path, part_bytes: int) -> None:
        self.folder, self._part_bytes = folder, part_bytes
        folder.mkdir(parents=True, exist_ok=True)
        for unfinished in folder.glob(f"*{_BUILDING}"):
            shutil.rmtree(unfinished)

    def add(
        self, ordinal: int, priority: int, name: str, suffix: str, payload: bytes, fields: Mapping[str, Any]
    ) -> bool:
        """Add a product; return False if it waits already.

        Parameters
        ----------
        ordinal : int
            Order of products of one priority.
        priority : int
            0 … 9, the lowest first.
        name : str
            Name of its files without suffix, unique for each product.
        fields : mapping
            Metadata for the sidecar, which adds the size, the digest and the files.
        """
        if any(path.name.split("-", 2)[2] == name for path in self._folders()):
            return False
        target = self.folder / f"{priority:d}-{ordinal:012d}-{name}"
        building = target.with_name(target.name + _BUILDING)
        building.mkdir()
        parts = [payload[i : i + self._part_bytes] for i in range(0, len(payload), self._part_bytes)] or [b""]
        names = [
            f"{name}.{suffix}" if len(parts) == 1 else f"{name}.{suffix}.{i:03d}"
            for i in range(1, 1 + len(parts))
        ]
        files = []
        for part_name, part in zip(names, parts, strict=True):
            (building / part_name).write_bytes(part)
            files.append({"name": part_name, "bytes": len(part), "sha256": hashlib.sha256(part).hexdigest()})
        sidecar = {
            **fields,
            "bytes": len(payload),
            "sha256": hashlib.sha256(payload).hexdigest(),
            "files": files,
        }
        (building / f"{name}{_SIDECAR}").write_text(json.dumps(sidecar, indent=1), encoding="utf-8")
        building.rename(target)
        return True

    def files(self) -> list[Path]:
        """Return the waiting files in the order of their transfer; the sidecar of a product is the last."""
        return [
            path
            for folder in self._folders()
            for path in sorted(folder.iterdir(), key=lambda p: (p.suffix == _SIDECAR, p.name))
        ]

    def is_ready(self, path: Path) -> bool:
        """Return whether a file can be sent: a sidecar only when no other file of its product waits."""
        return path.suffix != _SIDECAR or len(list(path.parent.iterdir())) == 1

    def remove(self, path: Path) -> None:
        """Remove a file that the ground segment has received."""
        path.unlink(missing_ok=True)
        if path.suffix == _SIDECAR:
            path.parent.rmdir()

    def size(self) -> tuple[int, int]:
        """Return the number of waiting products and the bytes of their files."""
        folders = self._folders()
        return len(folders), sum(path.stat().st_size for f in folders for path in f.iterdir())

    def _folders(self) -> list[Path]:
        return sorted(path for path in self.folder.iterdir() if not path.name.endswith(_BUILDING))

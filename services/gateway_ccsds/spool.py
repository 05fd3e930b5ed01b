# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on disk that wait for their transfer: a folder for each, with its files and a sidecar.

A folder is written under a temporary name and renamed when it is complete. Each file is removed when the
ground segment has received it. The sidecar is sent last: with it the ground segment has the complete product.
After a restart the remaining files are sent.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import threading
import uuid
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from cdff_common.output import replace_file

_SIDECAR = ".sidecar.json"
_BUILDING = ".part"


class Spool:
    """Products that wait in a folder, ordered by priority, then by ordinal; can be used by several threads.

    Parameters
    ----------
    folder : Path
    part_bytes : int
        Largest file; a larger payload is split into several files.
    """

    def __init__(self, folder: Path, part_bytes: int) -> None:
        self.folder, self._part_bytes = folder, part_bytes
        self._lock = threading.Lock()
        folder.mkdir(parents=True, exist_ok=True)
        for unfinished in folder.glob(f"*{_BUILDING}"):
            shutil.rmtree(unfinished)
        for product in self._folders():
            with suppress(OSError):  # only an empty folder, after the removal of the last file, is removed
                product.rmdir()

    def add(
        self, ordinal: int, priority: int, name: str, suffix: str, payload: bytes, fields: Mapping[str, Any]
    ) -> bool:
        """Add a product and return True; return False if the spool already contains it.

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
        if self._contains(name):
            return False
        building = self.folder / f"{uuid.uuid4().hex}{_BUILDING}"
        building.mkdir()
        try:
            self._write(building, name, suffix, payload, fields)
            with self._lock:
                if self._contains(name):
                    return False
                building.rename(self.folder / f"{priority:d}-{ordinal:012d}-{name}")
        finally:
            if building.exists():
                shutil.rmtree(building)
        return True

    def files(self) -> list[Path]:
        """Return the waiting files in the order of their transfer; the sidecar of a product is the last."""
        with self._lock:
            return [
                path
                for folder in self._folders()
                for path in sorted(folder.iterdir(), key=lambda p: (_is_sidecar(p), p.name))
            ]

    def is_ready(self, path: Path) -> bool:
        """Return True if the file can be sent now; a sidecar can when the other files were received."""
        return not _is_sidecar(path) or len(list(path.parent.iterdir())) == 1

    def remove(self, path: Path) -> None:
        """Remove a file that the ground segment has received."""
        with self._lock:
            path.unlink(missing_ok=True)
            if _is_sidecar(path):
                path.parent.rmdir()

    def size(self) -> tuple[int, int]:
        """Return the number of waiting products and the bytes of their files."""
        with self._lock:
            folders = self._folders()
            return len(folders), sum(path.stat().st_size for f in folders for path in f.iterdir())

    def _folders(self) -> list[Path]:
        return sorted(path for path in self.folder.iterdir() if not path.name.endswith(_BUILDING))

    def _contains(self, name: str) -> bool:
        return any(path.name.split("-", 2)[2] == name for path in self._folders())

    def _write(self, folder: Path, name: str, suffix: str, payload: bytes, fields: Mapping[str, Any]) -> None:
        """Write the files and the sidecar of a product."""
        parts = [payload[i : i + self._part_bytes] for i in range(0, len(payload), self._part_bytes)] or [b""]
        names = [
            f"{name}.{suffix}" if len(parts) == 1 else f"{name}.{suffix}.{i:03d}"
            for i in range(1, 1 + len(parts))
        ]
        files = []
        for part_name, part in zip(names, parts, strict=True):
            replace_file(folder / part_name, part, sync=True)
            files.append({"name": part_name, "bytes": len(part), "sha256": hashlib.sha256(part).hexdigest()})
        sidecar = {
            **fields,
            "bytes": len(payload),
            "sha256": hashlib.sha256(payload).hexdigest(),
            "files": files,
        }
        replace_file(folder / f"{name}{_SIDECAR}", json.dumps(sidecar, indent=1).encode(), sync=True)


def _is_sidecar(path: Path) -> bool:
    return path.name.endswith(_SIDECAR)

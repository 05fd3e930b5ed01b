# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Local copies of objects, up to a quota; the objects that were not used for the longest time are removed."""

from __future__ import annotations

import os
import tempfile
import threading
from collections import OrderedDict
from contextlib import suppress
from pathlib import Path
from typing import BinaryIO

_PART = ".part"


class ObjectCache:
    """Copies of objects in the files of a directory, which one process uses.

    A copy is not synced: its content is compared with the sums of the payload, as that of the object is.

    Parameters
    ----------
    directory : Path
    quota_bytes : int
        Largest sum of the sizes of the files.
    """

    def __init__(self, directory: Path, quota_bytes: int) -> None:
        self._directory = directory
        self._quota = quota_bytes
        self._lock = threading.Lock()
        directory.mkdir(parents=True, exist_ok=True)
        for leftover in directory.glob(f"*{_PART}"):
            leftover.unlink()
        files = sorted(((path, path.stat()) for path in directory.iterdir()), key=lambda f: f[1].st_mtime_ns)
        self._sizes = OrderedDict((path.name, stat.st_size) for path, stat in files)
        self._total = sum(self._sizes.values())

    @property
    def total_bytes(self) -> int:
        """Sum of the sizes of the copies."""
        return self._total

    def __contains__(self, name: str) -> bool:
        """Return whether there is a copy."""
        with self._lock:
            return name in self._sizes

    def open(self, name: str) -> BinaryIO | None:
        """Open a copy; None if there is none."""
        with self._lock:
            if name not in self._sizes:
                return None
            self._sizes.move_to_end(name)
        try:
            return (self._directory / name).open("rb")
        except FileNotFoundError:
            return None

    def add(self, name: str, content: bytes) -> None:
        """Keep a copy if it is within the quota; a full disk keeps none."""
        if len(content) > self._quota:
            return
        with suppress(OSError):
            descriptor, temporary = tempfile.mkstemp(suffix=_PART, dir=self._directory)
            try:
                with os.fdopen(descriptor, "wb") as file:
                    file.write(content)
                Path(temporary).rename(self._directory / name)
            except OSError:
                Path(temporary).unlink(missing_ok=True)
                raise
            with self._lock:
                self._total += len(content) - self._sizes.pop(name, 0)
                self._sizes[name] = len(content)
                while self._total > self._quota:
                    oldest, size = self._sizes.popitem(last=False)
                    self._total -= size
                    (self._directory / oldest).unlink(missing_ok=True)

    def remove(self, name: str) -> None:
        """Remove a copy."""
        with self._lock:
            self._total -= self._sizes.pop(name, 0)
        (self._directory / name).unlink(missing_ok=True)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Append-only files of records, each with its length and CRC-32.

A record is written after the commit of its change and handed to the disk without waiting for it: the end of
the process loses none, and the sync of the next commit also makes it durable. After a loss of power the last
records can be missing; they are written again from the database.
"""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator, Sequence
from pathlib import Path
from zlib import crc32

_PREFIX = struct.Struct("<II")
#: A file of at least this size is not appended to.
FILE_BYTES = 1 << 24


class ChangeFiles:
    """The files ``NNNNNNNN.changes`` in a directory. Not thread-safe."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        directory.mkdir(exist_ok=True)
        self._newest = max((int(path.stem) for path in self._paths()), default=0)
        self._descriptor = -1
        self._end = 0

    def append(self, records: Sequence[bytes]) -> None:
        """Append records; raises OSError, and then none of them is in the file."""
        data = b"".join(_PREFIX.pack(len(record), crc32(record)) + record for record in records)
        self._open()
        try:
            written = 0
            while written < len(data):
                written += os.pwrite(self._descriptor, memoryview(data)[written:], self._end + written)
        except OSError:
            os.ftruncate(self._descriptor, self._end)
            raise
        # starts writing to the disk without waiting for it
        os.posix_fadvise(self._descriptor, self._end, len(data), os.POSIX_FADV_DONTNEED)
        self._end += len(data)

    def last(self) -> bytes | None:
        """Return the newest intact record; None if there is none."""
        for path in reversed(self._paths()):
            record = None
            for record in _records(path):  # noqa: B007  # the last one is used
                pass
            if record is not None:
                return record
        return None

    def __iter__(self) -> Iterator[bytes]:
        """Yield all intact records, in the order of their insertion."""
        for path in self._paths():
            yield from _records(path)

    def close(self) -> None:
        """Make the records durable and close the file."""
        if self._descriptor >= 0:
            os.fdatasync(self._descriptor)
            os.close(self._descriptor)
            self._descriptor = -1

    def _paths(self) -> list[Path]:
        return sorted(self._directory.glob("*.changes"))

    def _open(self) -> None:
        """Open the newest file behind its last intact record, or a new file if it is full."""
        if self._descriptor >= 0 and self._end < FILE_BYTES:
            return
        if self._descriptor >= 0 or self._newest == 0:
            self.close()
            self._newest += 1
        path = self._directory / f"{self._newest:08d}.changes"
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        self._end = sum(_PREFIX.size + len(record) for record in _records(path))
        os.ftruncate(self._descriptor, self._end)
        if self._end >= FILE_BYTES:
            self._open()


def _records(path: Path) -> Iterator[bytes]:
    """Yield the records of a file up to the first one that is not intact."""
    with path.open("rb") as file:
        while len(prefix := file.read(_PREFIX.size)) == _PREFIX.size:
            length, checksum = _PREFIX.unpack(prefix)
            record = file.read(length)
            if not length or len(record) != length or crc32(record) != checksum:
                return
            yield record

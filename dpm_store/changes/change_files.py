# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Append-only files of records, each with its length and CRC-32.

A record is written after the commit of its change and handed to the disk without waiting for it: the end of
the process loses none, and the sync of the next commit also makes it durable. After a loss of power the last
records can be missing; they are written again from the database.

Full files are compressed. A file is removed only after its compressed copy is durable and was read back, so
that the records are complete at any time; if both exist, the uncompressed one counts.
"""

from __future__ import annotations

import gzip
import logging
import os
import shutil
import struct
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO
from zlib import crc32

from dpm_store.payloads.blobs import fsync

logger = logging.getLogger(__name__)

_PREFIX = struct.Struct("<II")
#: A file of at least this size is not appended to.
FILE_BYTES = 1 << 22
_SUFFIX, _COMPRESSED, _PART = ".changes", ".changes.gz", ".changes.part"
#: Files compressed when a file is full: one becomes full at a time, and two shorten an older record.
_COMPRESSED_AT_ONCE = 2


class ChangeFiles:
    """The files ``NNNNNNNN.changes`` and ``NNNNNNNN.changes.gz`` in a directory. Not thread-safe."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        directory.mkdir(exist_ok=True)
        newest = max(self._paths(), key=_number, default=None)
        self._newest = 0 if newest is None else _number(newest) + (newest.suffix != _SUFFIX)
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
        """Return the file of each number, in order."""
        files = {_number(path): path for path in self._directory.glob(f"*{_COMPRESSED}")}
        files |= {_number(path): path for path in self._directory.glob(f"*{_SUFFIX}")}
        return [files[number] for number in sorted(files)]

    def _compress_full(self) -> None:
        """Compress the oldest full files; a failure of the disk is logged, and the next call tries again."""
        full = [path for path in self._paths() if path.suffix == _SUFFIX and _number(path) < self._newest]
        try:
            for path in full[:_COMPRESSED_AT_ONCE]:
                _compress(path)
        except OSError as error:
            logger.warning("the record of changes is not compressed: %s", error)

    def _open(self) -> None:
        """Open the newest file behind its last intact record, or a new file if it is full."""
        if self._descriptor >= 0 and self._end < FILE_BYTES:
            return
        if self._descriptor >= 0 or self._newest == 0:
            self.close()
            self._newest += 1
        path = self._directory / f"{self._newest:08d}{_SUFFIX}"
        self._descriptor = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        self._end = sum(_PREFIX.size + len(record) for record in _records(path))
        os.ftruncate(self._descriptor, self._end)
        if self._end >= FILE_BYTES:
            self._open()
        else:
            self._compress_full()


def _number(path: Path) -> int:
    return int(path.name.partition(".")[0])


def _compress(path: Path) -> None:
    """Replace a file by its compressed copy; an interruption at any time leaves the records complete."""
    part, target = path.with_suffix(_PART), path.with_suffix(_COMPRESSED)
    try:
        with path.open("rb") as source, gzip.open(part, "wb", compresslevel=6) as copy:
            shutil.copyfileobj(source, copy)
        fsync(part)
        if list(_records(part)) != list(_records(path)):
            raise OSError(f"{part}: the compressed copy differs from {path.name}")
    except OSError:
        part.unlink(missing_ok=True)
        raise
    part.rename(target)
    fsync(path.parent)
    path.unlink()


def _records(path: Path) -> Iterator[bytes]:
    """Yield the records of a file up to the first one that is not intact."""
    with gzip.open(path) if path.suffix != _SUFFIX else path.open("rb") as file:
        while len(prefix := _read(file, _PREFIX.size)) == _PREFIX.size:
            length, checksum = _PREFIX.unpack(prefix)
            record = _read(file, length)
            if not length or len(record) != length or crc32(record) != checksum:
                return
            yield record


def _read(file: BinaryIO | gzip.GzipFile, size: int) -> bytes:
    """Return the next bytes of a file; less at its end or where its compression is damaged."""
    try:
        return file.read(size)
    except (EOFError, zlib.error, gzip.BadGzipFile):
        return b""

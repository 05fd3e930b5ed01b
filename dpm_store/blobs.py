# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payload files, named by their SHA-256: written whole and synced before anything refers to them.

Order of a write: temporary file, fsync, rename, fsync of the directory; only then may a row name it. A crash in
between leaves a file that no row names, which ``collect`` removes. Every chunk carries a CRC-32 in its row, so that a
read of any part is checked without reading the rest (the database would not notice a flipped bit).
"""

from __future__ import annotations

import errno
import hashlib
import os
import struct
import tempfile
import zlib
from collections.abc import Iterator
from pathlib import Path

from cdff_common.errors import InputError, StorageError

CHUNK_BYTES = 1 << 18
#: Errors that say so.
FULL = (errno.ENOSPC, errno.EDQUOT)


def digest(payload: bytes) -> str:
    """SHA-256 of a payload, hexadecimal."""
    return hashlib.sha256(payload).hexdigest()


def chunk_sums(payload: bytes) -> bytes:
    """CRC-32 of each chunk of ``CHUNK_BYTES``, little-endian, 4 bytes each."""
    view = memoryview(payload)
    sums = [zlib.crc32(view[i : i + CHUNK_BYTES]) for i in range(0, len(payload), CHUNK_BYTES)]
    return struct.pack(f"<{len(sums)}I", *sums)


def covering(offset: int, length: int) -> tuple[int, int]:
    """First chunk and one past the last that hold bytes ``offset`` to ``offset + length``."""
    return offset // CHUNK_BYTES, -(-(offset + length) // CHUNK_BYTES)


def check_chunks(data: bytes, first_chunk: int, sums: bytes, what: str) -> None:
    """Compare chunk-aligned ``data`` with the sums written at insertion.

    Raises
    ------
    StorageError
        If a chunk differs: what was read is not what was written.
    """
    for i in range(0, len(data), CHUNK_BYTES):
        chunk = first_chunk + i // CHUNK_BYTES
        (expected,) = struct.unpack_from("<I", sums, 4 * chunk)
        if zlib.crc32(memoryview(data)[i : i + CHUNK_BYTES]) != expected:
            raise StorageError(
                f"{what}: bytes {chunk * CHUNK_BYTES}… are not what was written; the disk changed them, not served"
            )


class BlobFiles:
    """The files below ``directory``; two levels, so that no directory grows past some thousand entries."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        for left in directory.glob("*.part"):
            left.unlink()

    def path(self, sha256: str) -> Path:
        """Where the payload with this digest lies."""
        if len(sha256) != 64 or not set(sha256) <= set("0123456789abcdef"):
            raise InputError(f"digest {sha256[:80]!r}: expected 64 hexadecimal digits")
        return self._directory / sha256[:2] / sha256[2:]

    def write(self, sha256: str, payload: bytes) -> None:
        """Make the payload durable under its digest; one that lies there already is compared, and mended if it differs.

        Raises
        ------
        StorageError
            If the disk is full or fails; nothing is left behind.
        """
        target = self.path(sha256)
        try:
            if _holds(target, payload) and _made_durable(target):
                return
            new_directory = not target.parent.exists()
            target.parent.mkdir(exist_ok=True)
            if new_directory:
                sync(self._directory)
            descriptor, part = tempfile.mkstemp(suffix=".part", dir=self._directory)
            try:
                with os.fdopen(descriptor, "wb") as file:
                    file.write(payload)
                    file.flush()
                    os.fsync(file.fileno())
                Path(part).rename(target)
            except OSError:
                Path(part).unlink(missing_ok=True)
                raise
            sync(target.parent)
        except OSError as error:
            why = "the disk is full; delete products" if error.errno in FULL else "the disk failed"
            raise StorageError(f"payload of {len(payload)} bytes not stored: {why} ({error.strerror})") from error

    def read(self, sha256: str, size: int, sums: bytes, offset: int, length: int, what: str) -> bytes:
        """Return ``length`` bytes from ``offset``, checked.

        Raises
        ------
        StorageError
            If the file is gone, short, or differs from what was written.
        """
        first, last = covering(offset, length)
        start, stop = first * CHUNK_BYTES, min(last * CHUNK_BYTES, size)
        try:
            with self.path(sha256).open("rb") as file:
                file.seek(start)
                data = file.read(stop - start)
        except OSError as error:
            raise StorageError(f"{what}: payload file not readable ({error.strerror})") from error
        if len(data) != stop - start:
            raise StorageError(f"{what}: payload file ends at byte {start + len(data)}, expected {size}; not served")
        check_chunks(data, first, sums, what)
        return data if (start, stop) == (offset, offset + length) else data[offset - start : offset - start + length]

    def names(self) -> Iterator[list[str]]:
        """Digests of all files that are there, one directory after the other."""
        for directory in sorted(self._directory.glob("??")):
            yield [directory.name + path.name for path in directory.iterdir()]

    def remove(self, sha256: str) -> int:
        """Delete a file; returns the bytes freed.

        Raises
        ------
        StorageError
            If the disk fails.
        """
        path = self.path(sha256)
        try:
            size = path.stat().st_size
            path.unlink()
        except FileNotFoundError:
            return 0
        except OSError as error:
            raise StorageError(f"payload {sha256} not removed ({error.strerror})") from error
        return size


def _holds(path: Path, payload: bytes) -> bool:
    """Tell whether a file is there and is the payload, byte for byte."""
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size != len(payload):
                return False
            view = memoryview(payload)
            return all(file.read(CHUNK_BYTES) == view[i : i + CHUNK_BYTES] for i in range(0, len(view), CHUNK_BYTES))
    except FileNotFoundError:
        return False


def _made_durable(path: Path) -> bool:
    """Sync a file that somebody wrote and may have been killed before it was durable; False if it is gone since."""
    try:
        sync(path)
    except FileNotFoundError:  # a collection took it
        return False
    sync(path.parent)
    return True


def sync(path: Path) -> None:
    """Make a file or directory durable."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

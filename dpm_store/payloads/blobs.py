# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Payload files, named by their SHA-256, written completely and synced before a row refers to them.

Order of a write: temporary file, fsync, rename, fsync of the directory, row. A crash in between leaves a file
without a row, which ``collect`` removes. The row stores a CRC-32 of every chunk, so that any part can be
checked without reading the rest.

A file that is shorter than its payload is compressed, chunk by chunk (``seekable``). Payloads that do not
become clearly smaller are stored as they are.
"""

from __future__ import annotations

import errno
import hashlib
import os
import struct
import tempfile
import threading
import zlib
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path
from typing import BinaryIO, NamedTuple

from cdff_common.errors import CodecError, InputError, StorageError
from dpm_store.payloads.seekable import compress, read_frames

CHUNK_BYTES = 1 << 18
#: A payload is stored compressed if this makes it smaller than the fraction.
WORTHWHILE = 0.8
#: Number of files whose content is not compared again while they are unchanged.
_REMEMBERED = 64
#: Errors of a full disk.
FULL = (errno.ENOSPC, errno.EDQUOT)


def digest(payload: bytes) -> str:
    """Return the SHA-256 of a payload, hexadecimal."""
    return hashlib.sha256(payload).hexdigest()


def chunk_sums(payload: bytes) -> bytes:
    """Return the CRC-32 of each chunk of ``CHUNK_BYTES``, little-endian, 4 bytes each."""
    view = memoryview(payload)
    sums = [zlib.crc32(view[i : i + CHUNK_BYTES]) for i in range(0, len(payload), CHUNK_BYTES)]
    return struct.pack(f"<{len(sums)}I", *sums)


def chunk_range(offset: int, length: int) -> tuple[int, int]:
    """Return the first chunk and one past the last that hold bytes ``offset`` to ``offset + length``."""
    return offset // CHUNK_BYTES, -(-(offset + length) // CHUNK_BYTES)


def check_chunks(data: bytes, first_chunk: int, sums: bytes, subject: str) -> None:
    """Compare chunk-aligned ``data`` with the sums written at insertion.

    Raises
    ------
    StorageError
        If a chunk differs.
    """
    for i in range(0, len(data), CHUNK_BYTES):
        chunk = first_chunk + i // CHUNK_BYTES
        (expected,) = struct.unpack_from("<I", sums, 4 * chunk)
        if zlib.crc32(memoryview(data)[i : i + CHUNK_BYTES]) != expected:
            raise StorageError(f"{subject}: bytes {chunk * CHUNK_BYTES}… are corrupt on the disk")


class _State(NamedTuple):
    """Identity and last change of a file."""

    inode: int
    size: int
    modified_ns: int
    changed_ns: int


class BlobFiles:
    """The payload files below ``directory``, in two levels to keep directories small.

    Files that a killed process did not complete are removed, unless another process writes.
    """

    def __init__(self, directory: Path, *, removes_parts: bool = True) -> None:
        self._directory = directory
        self._lock = threading.Lock()
        self._written: OrderedDict[str, _State] = OrderedDict()
        directory.mkdir(parents=True, exist_ok=True)
        for leftover in directory.glob("*.part") if removes_parts else ():
            leftover.unlink()

    def path(self, sha256: str) -> Path:
        """Return the path of the payload with this digest."""
        if len(sha256) != 64 or not set(sha256) <= set("0123456789abcdef"):
            raise InputError(f"digest {sha256[:80]!r}: expected 64 hexadecimal digits")
        return self._directory / sha256[:2] / sha256[2:]

    def write(self, sha256: str, payload: bytes, sums: bytes) -> None:
        """Make the payload durable under its digest; an existing file is replaced if it differs.

        Parameters
        ----------
        sha256 : str
        payload : bytes
        sums : bytes
            ``chunk_sums`` of the payload.

        Raises
        ------
        StorageError
            If the disk is full or fails; no file remains.
        """
        target = self.path(sha256)
        try:
            if self._is_unchanged(sha256, target) and _make_durable(target):
                return
            content = stored_form(payload, sums)
            if _has_content(target, content) and _make_durable(target):
                self._remember(sha256, target)
                return
            new_directory = not target.parent.exists()
            target.parent.mkdir(exist_ok=True)
            if new_directory:
                fsync(self._directory)
            descriptor, temporary = tempfile.mkstemp(suffix=".part", dir=self._directory)
            try:
                with os.fdopen(descriptor, "wb") as file:
                    file.write(content)
                    file.flush()
                    os.fsync(file.fileno())
                Path(temporary).rename(target)
            except OSError:
                Path(temporary).unlink(missing_ok=True)
                raise
            fsync(target.parent)
            self._remember(sha256, target)
        except OSError as error:
            why = "the disk is full; delete products" if error.errno in FULL else "the disk failed"
            raise StorageError(
                f"payload of {len(payload)} bytes not stored: {why} ({error.strerror})"
            ) from error

    def read(self, sha256: str, size: int, sums: bytes, offset: int, length: int, subject: str) -> bytes:
        """Return ``length`` bytes from ``offset`` after comparison with the sums.

        Raises
        ------
        StorageError
            If the file is missing or short, or does not match the sums.
        """
        try:
            return self._read_checked(sha256, size, sums, offset, length, subject)
        except StorageError:
            with self._lock:
                self._written.pop(sha256, None)
            raise

    def _read_checked(
        self, sha256: str, size: int, sums: bytes, offset: int, length: int, subject: str
    ) -> bytes:
        """Return bytes of a payload after comparison of their chunks with the sums; raises StorageError."""
        first, last = chunk_range(offset, length)
        start, stop = first * CHUNK_BYTES, min(last * CHUNK_BYTES, size)
        data = self._read_chunks(sha256, size, sums, first, last, subject)
        return (
            data
            if (start, stop) == (offset, offset + length)
            else data[offset - start : offset - start + length]
        )

    def _read_chunks(self, sha256: str, size: int, sums: bytes, first: int, last: int, subject: str) -> bytes:
        """Return the chunks ``first`` to ``last`` (exclusive) after a check; raises StorageError."""
        start, stop = first * CHUNK_BYTES, min(last * CHUNK_BYTES, size)
        try:
            file, stored = self._open(sha256, subject)
            with closing(file):
                if stored < size:
                    data, is_checked = read_frames(file, stored, size, first, last, sums)
                    if not is_checked:
                        check_chunks(data, first, sums, subject)
                    return data
                file.seek(start)
                data = file.read(stop - start)
        except OSError as error:
            raise StorageError(f"{subject}: payload file not readable ({error.strerror})") from error
        except CodecError as error:
            raise StorageError(
                f"{subject}: payload file of {stored} bytes is corrupt on the disk ({error}); not served"
            ) from error
        if len(data) != stop - start:
            raise StorageError(
                f"{subject}: payload file ends at byte {start + len(data)}, expected {size}; not served"
            )
        check_chunks(data, first, sums, subject)
        return data

    def _open(self, sha256: str, subject: str) -> tuple[BinaryIO, int]:
        """Return a stored payload as a file, and its size; raises OSError or StorageError."""
        file = self.path(sha256).open("rb")
        return file, os.fstat(file.fileno()).st_size

    def names(self) -> Iterator[list[str]]:
        """Yield the SHA-256 digests of the payload files, one list for each directory."""
        for directory in sorted(self._directory.glob("??")):
            yield [directory.name + path.name for path in directory.iterdir()]

    def remove(self, sha256: str) -> int:
        """Delete a file and return the bytes freed.

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

    def _remember(self, sha256: str, path: Path) -> None:
        """Remember the state of a file that has its content."""
        try:
            state = _state(path)
        except FileNotFoundError:  # removed by a collection
            return
        with self._lock:
            self._written[sha256] = state
            self._written.move_to_end(sha256)
            while len(self._written) > _REMEMBERED:
                self._written.popitem(last=False)

    def _is_unchanged(self, sha256: str, path: Path) -> bool:
        """Return whether a remembered file has not changed since."""
        with self._lock:
            remembered = self._written.get(sha256)
        try:
            return remembered is not None and _state(path) == remembered
        except FileNotFoundError:
            return False


def stored_form(payload: bytes, sums: bytes) -> bytes:
    """Return the content of the file of a payload with its ``chunk_sums``: compressed, or as it is."""
    compressed = compress(payload, CHUNK_BYTES, sums)
    return compressed if len(compressed) < WORTHWHILE * len(payload) else payload


def _state(path: Path) -> _State:
    stat = path.stat()
    return _State(stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns)


def _has_content(path: Path, content: bytes) -> bool:
    """Return whether a file exists and has this content."""
    try:
        with path.open("rb") as file:
            if os.fstat(file.fileno()).st_size != len(content):
                return False
            view = memoryview(content)
            return all(
                file.read(CHUNK_BYTES) == view[i : i + CHUNK_BYTES] for i in range(0, len(view), CHUNK_BYTES)
            )
    except FileNotFoundError:
        return False


def _make_durable(path: Path) -> bool:
    """Sync a file whose writer may have been killed before it was durable; return False if it is missing."""
    try:
        fsync(path)
    except FileNotFoundError:  # removed by a collection
        return False
    fsync(path.parent)
    return True


def fsync(path: Path) -> None:
    """Make a file or directory durable."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)

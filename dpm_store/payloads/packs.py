# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pack files: small payloads, appended in sequence, with one sync for any number of them.

A database row stores the location of its payload (pack number and offset); it is written after the payload is
synced. Ranges that no row references, of deleted products or after a crash, are freed in place by punching
holes, so that nothing is copied and a full disk can be emptied. On a file system without holes a pack is
removed once all of it is unreferenced.
"""

from __future__ import annotations

import ctypes
import errno
import fcntl
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import groupby
from pathlib import Path

from cdff_common.errors import StorageError
from dpm_store.payloads.blobs import FULL, check_chunks, fsync

#: Packs of at least this size are not appended to.
PACK_BYTES = 1 << 28
#: A file system frees whole blocks.
BLOCK_BYTES = 4096
#: A location is the number of a pack, shifted by this number of bits, plus the offset in the pack.
_OFFSET_BITS = 32
#: Bytes copied at once.
_COPY_BYTES = 1 << 24
#: Flags of fallocate(2): free a range of a file without changing its size.
_KEEP_SIZE, _PUNCH_HOLE = 1, 2
_HAS_NO_HOLES = (errno.EOPNOTSUPP, errno.ENOSYS)

#: Location and size of a payload.
Span = tuple[int, int]


def pack_of(location: int) -> int:
    """Return the number of the pack of a location."""
    return location >> _OFFSET_BITS


def location_range(number: int) -> tuple[int, int]:
    """Return the first location of a pack, and of the next pack."""
    return number << _OFFSET_BITS, (number + 1) << _OFFSET_BITS


def merge_spans(spans: Iterable[Span]) -> list[Span]:
    """Return ordered spans with adjacent ones joined."""
    joined: list[Span] = []
    for location, size in spans:
        if joined and sum(joined[-1]) == location:
            joined[-1] = (joined[-1][0], joined[-1][1] + size)
        else:
            joined.append((location, size))
    return joined


class PackFiles:
    """The packs in ``directory``. One process appends to them, in one thread at a time."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        self._newest = max(self.numbers(), default=0)
        self._descriptor = -1
        self._end = self._synced = 0

    def path(self, number: int) -> Path:
        """Return the path of a pack."""
        return self._directory / f"{number:08d}.pack"

    def numbers(self) -> list[int]:
        """Return the numbers of all packs."""
        return sorted(int(path.stem) for path in self._directory.glob("*.pack"))

    def allocated_bytes(self) -> int:
        """Return the bytes of all packs on the disk, without holes."""
        sizes = (self.path(number).stat() for number in self.numbers())
        return sum(min(size.st_size, size.st_blocks * 512) for size in sizes)

    def append(self, payloads: Sequence[bytes]) -> list[int]:
        """Write payloads, durable after ``flush``, and return their locations.

        Raises
        ------
        StorageError
            If the disk is full or fails; the unsynced end of the pack is discarded.
        """
        locations: list[int] = []
        first = 0
        with self._discarding_on_error():
            while first < len(payloads):
                self._open()
                start, last = self._end, first
                while last < len(payloads) and (last == first or self._end < PACK_BYTES):
                    locations.append(location_range(self._newest)[0] + self._end)
                    self._end += len(payloads[last])
                    last += 1
                _write(self._descriptor, b"".join(payloads[first:last]), start)
                # starts writing to the disk before flush waits for it
                os.posix_fadvise(self._descriptor, start, self._end - start, os.POSIX_FADV_DONTNEED)
                first = last
        return locations

    def flush(self) -> None:
        """Make all appended payloads durable; raises like ``append``."""
        with self._discarding_on_error():
            self._sync()

    def read(self, span: Span, sums: bytes, subject: str) -> bytes:
        """Return a payload after comparison with its sums.

        Raises
        ------
        StorageError
            If the pack is missing or short, or the payload does not match the sums.
        """
        location, size = span
        start = location - location_range(pack_of(location))[0]
        try:
            with self.path(pack_of(location)).open("rb", buffering=0) as file:
                data = os.pread(file.fileno(), size, start)
        except OSError as error:
            raise StorageError(f"{subject}: pack not readable ({error.strerror})") from error
        if len(data) != size:
            raise StorageError(
                f"{subject}: its pack ends at byte {start + len(data)}, expected {start + size}"
            )
        check_chunks(data, 0, sums, subject)
        return data

    def reclaim(self, number: int, live: Sequence[Span]) -> bool:
        """Free the ranges of a pack outside the ordered spans ``live``; return False while a copy is made.

        Raises
        ------
        StorageError
            If the disk fails.
        """
        try:
            with self._exclusive() as is_exclusive:
                if not is_exclusive:
                    return False
                if not live and number != self._newest:
                    self.path(number).unlink(missing_ok=True)
                    return True
                with self.path(number).open("r+b", buffering=0) as file:
                    size = os.fstat(file.fileno()).st_size
                    for start, stop in _gaps(live, location_range(number)[0], size):
                        _punch(file.fileno(), start, stop)
        except FileNotFoundError:
            return True
        except OSError as error:
            raise StorageError(f"pack {number}: no space freed ({error.strerror})") from error
        return True

    def copy(self, spans: Sequence[Span], target: PackFiles) -> None:
        """Copy spans to the same locations of other packs; raises OSError if the disk fails."""
        for number, of_pack in groupby(spans, lambda span: pack_of(span[0])):
            first = location_range(number)[0]
            with (
                self.path(number).open("rb", buffering=0) as original,
                target.path(number).open("xb", buffering=0) as copy,
            ):
                for location, size in of_pack:
                    for position in range(location - first, location - first + size, _COPY_BYTES):
                        length = min(_COPY_BYTES, location - first + size - position)
                        _write(copy.fileno(), os.pread(original.fileno(), length, position), position)

    @contextmanager
    def copying(self) -> Iterator[None]:
        """Keep ``reclaim`` of any process from freeing ranges."""
        with _locked(self._directory, fcntl.LOCK_SH):
            yield

    @contextmanager
    def _exclusive(self) -> Iterator[bool]:
        try:
            with _locked(self._directory, fcntl.LOCK_EX | fcntl.LOCK_NB):
                yield True
        except BlockingIOError:
            yield False

    def close(self) -> None:
        """Close the pack that is appended to."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _open(self) -> None:
        """Open a pack that can be appended to."""
        if self._descriptor >= 0 and self._end < PACK_BYTES:
            return
        if self._descriptor >= 0 or self._newest == 0:
            self._newest += 1
        if self._descriptor >= 0:
            self._sync()
            self.close()
        self._descriptor = os.open(self.path(self._newest), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        self._end = self._synced = os.fstat(self._descriptor).st_size
        if self._end >= PACK_BYTES:
            self._open()

    def _sync(self) -> None:
        if self._end > self._synced:
            os.fdatasync(self._descriptor)
            if self._synced == 0:
                fsync(self._directory)
            self._synced = self._end

    @contextmanager
    def _discarding_on_error(self) -> Iterator[None]:
        """Stop appending to the pack after a failure: the content of its unsynced end is unknown."""
        try:
            yield
        except OSError as error:
            size = self._end - self._synced
            if self._descriptor >= 0:
                with suppress(OSError):  # what remains is reclaimed, as after a crash
                    os.ftruncate(self._descriptor, self._synced)
                    if self._synced == 0:
                        self.path(self._newest).unlink()
                self._end = self._synced = PACK_BYTES
            why = "the disk is full; delete products" if error.errno in FULL else "the disk failed"
            raise StorageError(f"payloads of {size} bytes not stored: {why} ({error.strerror})") from error


def _write(descriptor: int, data: bytes, position: int) -> None:
    """Write all bytes at a position of a file, also if the system writes them in parts."""
    view = memoryview(data)
    while view:
        written = os.pwrite(descriptor, view, position)
        view, position = view[written:], position + written


def _gaps(live: Sequence[Span], first: int, size: int) -> Iterator[tuple[int, int]]:
    """Return the ranges of whole blocks of a pack that no payload overlaps."""
    end = 0
    for location, length in (*live, (first + size, 0)):
        start, stop = -(-end // BLOCK_BYTES) * BLOCK_BYTES, (location - first) // BLOCK_BYTES * BLOCK_BYTES
        if start < stop:
            yield start, stop
        end = max(end, location - first + length)


def _punch(descriptor: int, start: int, stop: int) -> None:
    fallocate = ctypes.CDLL(None, use_errno=True).fallocate
    fallocate.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    if fallocate(descriptor, _KEEP_SIZE | _PUNCH_HOLE, start, stop - start):
        number = ctypes.get_errno()
        if number not in _HAS_NO_HOLES:
            raise OSError(number, os.strerror(number))


@contextmanager
def _locked(directory: Path, operation: int) -> Iterator[None]:
    descriptor = os.open(directory, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, operation)
        yield
    finally:
        os.close(descriptor)

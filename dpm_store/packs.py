# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Small payloads, one after the other in files that only grow: written once, one sync for any number of them.

A row of the database says where its payload begins (``place``); it is written after the payload was synced. What no row
names, of deleted products or of a crash in between, is given back to the disk where it lies: holes are punched, so that
nothing is copied and a full disk can be emptied. Where the file system has no holes a pack goes when all of it may go.
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
from dpm_store.blobs import FULL, check_chunks, sync

#: A pack that has reached this size is not added to.
PACK_BYTES = 1 << 28
#: What a file system gives back: whole blocks.
BLOCK_BYTES = 4096
_OFFSET_BITS = 32
#: Copied at a time.
_PART = 1 << 24
_KEEP_SIZE, _PUNCH_HOLE = 1, 2
_HAS_NO_HOLES = (errno.EOPNOTSUPP, errno.ENOSYS)

#: Where a payload begins, and its bytes.
Span = tuple[int, int]


def pack_of(place: int) -> int:
    """Number of the pack that a place is in."""
    return place >> _OFFSET_BITS


def places_of(number: int) -> tuple[int, int]:
    """First place of a pack, and the first after it."""
    return number << _OFFSET_BITS, (number + 1) << _OFFSET_BITS


def merged(spans: Iterable[Span]) -> list[Span]:
    """Spans in order as few: those that follow each other are one."""
    found: list[Span] = []
    for place, size in spans:
        if found and sum(found[-1]) == place:
            found[-1] = (found[-1][0], found[-1][1] + size)
        else:
            found.append((place, size))
    return found


class PackFiles:
    """The packs below ``directory``. One process adds to them, in one thread at a time."""

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        directory.mkdir(parents=True, exist_ok=True)
        self._newest = max(self.numbers(), default=0)
        self._descriptor = -1
        self._end = self._settled = 0

    def path(self, number: int) -> Path:
        """Where a pack lies."""
        return self._directory / f"{number:08d}.pack"

    def numbers(self) -> list[int]:
        """Of all packs that are there."""
        return sorted(int(path.stem) for path in self._directory.glob("*.pack"))

    def append(self, payloads: Sequence[bytes]) -> list[int]:
        """Write payloads, durable once ``settle`` returns; returns where each begins.

        Raises
        ------
        StorageError
            If the disk is full or fails; what was written is given up.
        """
        places: list[int] = []
        first = 0
        with self._giving_up():
            while first < len(payloads):
                self._open()
                begin, last = self._end, first
                while last < len(payloads) and (last == first or self._end < PACK_BYTES):
                    places.append(places_of(self._newest)[0] + self._end)
                    self._end += len(payloads[last])
                    last += 1
                _write(self._descriptor, b"".join(payloads[first:last]), begin)
                # the disk begins now, not when it is waited for
                os.posix_fadvise(self._descriptor, begin, self._end - begin, os.POSIX_FADV_DONTNEED)
                first = last
        return places

    def settle(self) -> None:
        """Wait until the disk has what was written.

        Raises
        ------
        StorageError
            If the disk is full or fails; what was written is given up.
        """
        with self._giving_up():
            self._settle()

    def read(self, span: Span, sums: bytes, what: str) -> bytes:
        """Return a payload, checked.

        Raises
        ------
        StorageError
            If the pack is gone, short, or differs from what was written.
        """
        place, size = span
        start = place - places_of(pack_of(place))[0]
        try:
            with self.path(pack_of(place)).open("rb", buffering=0) as file:
                data = os.pread(file.fileno(), size, start)
        except OSError as error:
            raise StorageError(f"{what}: pack not readable ({error.strerror})") from error
        if len(data) != size:
            raise StorageError(f"{what}: its pack ends at byte {start + len(data)}, expected {start + size}")
        check_chunks(data, 0, sums, what)
        return data

    def reclaim(self, number: int, kept: Sequence[Span]) -> bool:
        """Give the disk back what lies between the payloads that are kept, in order; False while a copy is made.

        Raises
        ------
        StorageError
            If the disk fails.
        """
        try:
            with self._not_copied() as free:
                if not free:
                    return False
                if not kept and number != self._newest:
                    self.path(number).unlink(missing_ok=True)
                    return True
                with self.path(number).open("r+b", buffering=0) as file:
                    size = os.fstat(file.fileno()).st_size
                    for start, stop in _gaps(kept, places_of(number)[0], size):
                        _punch(file.fileno(), start, stop)
        except FileNotFoundError:
            return True
        except OSError as error:
            raise StorageError(f"pack {number}: nothing given back to the disk ({error.strerror})") from error
        return True

    def copy(self, spans: Sequence[Span], target: PackFiles) -> None:
        """Copy what lies in these to the same places of other packs; raises OSError as the disk does."""
        for number, of_pack in groupby(spans, lambda span: pack_of(span[0])):
            first = places_of(number)[0]
            with (
                self.path(number).open("rb", buffering=0) as there,
                target.path(number).open("xb", buffering=0) as here,
            ):
                for place, size in of_pack:
                    for at in range(place - first, place - first + size, _PART):
                        length = min(_PART, place - first + size - at)
                        _write(here.fileno(), os.pread(there.fileno(), length, at), at)

    @contextmanager
    def copying(self) -> Iterator[None]:
        """While this lasts, in any process, what lies in the packs stays."""
        with _locked(self._directory, fcntl.LOCK_SH):
            yield

    @contextmanager
    def _not_copied(self) -> Iterator[bool]:
        try:
            with _locked(self._directory, fcntl.LOCK_EX | fcntl.LOCK_NB):
                yield True
        except BlockingIOError:
            yield False

    def close(self) -> None:
        """Close the pack that is added to."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

    def _open(self) -> None:
        """Have a pack open that has room."""
        if self._descriptor >= 0 and self._end < PACK_BYTES:
            return
        if self._descriptor >= 0 or self._newest == 0:
            self._newest += 1
        if self._descriptor >= 0:
            self._settle()
            self.close()
        self._descriptor = os.open(self.path(self._newest), os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o644)
        self._end = self._settled = os.fstat(self._descriptor).st_size
        if self._end >= PACK_BYTES:
            self._open()

    def _settle(self) -> None:
        if self._end > self._settled:
            os.fdatasync(self._descriptor)
            if self._settled == 0:
                sync(self._directory)
            self._settled = self._end

    @contextmanager
    def _giving_up(self) -> Iterator[None]:
        """After a failure nothing is added to this pack any more: what the disk has of its end is not known."""
        try:
            yield
        except OSError as error:
            size = self._end - self._settled
            if self._descriptor >= 0:
                with suppress(OSError):  # what stays is reclaimed, as after a crash
                    os.ftruncate(self._descriptor, self._settled)
                    if self._settled == 0:
                        self.path(self._newest).unlink()
                self._end = self._settled = PACK_BYTES
            why = "the disk is full; delete products" if error.errno in FULL else "the disk failed"
            raise StorageError(f"payloads of {size} bytes not stored: {why} ({error.strerror})") from error


def _write(descriptor: int, data: bytes, at: int) -> None:
    view = memoryview(data)
    while view:
        written = os.pwrite(descriptor, view, at)
        view, at = view[written:], at + written


def _gaps(kept: Sequence[Span], first: int, size: int) -> Iterator[tuple[int, int]]:
    """Whole blocks of a pack that no payload touches."""
    end = 0
    for place, length in (*kept, (first + size, 0)):
        start, stop = -(-end // BLOCK_BYTES) * BLOCK_BYTES, (place - first) // BLOCK_BYTES * BLOCK_BYTES
        if start < stop:
            yield start, stop
        end = max(end, place - first + length)


def _punch(descriptor: int, start: int, stop: int) -> None:
    fallocate = ctypes.CDLL(None, use_errno=True).fallocate
    fallocate.argtypes = (ctypes.c_int, ctypes.c_int, ctypes.c_int64, ctypes.c_int64)
    if fallocate(descriptor, _KEEP_SIZE | _PUNCH_HOLE, start, stop - start):
        number = ctypes.get_errno()
        if number not in _HAS_NO_HOLES:
            raise OSError(number, os.strerror(number))


@contextmanager
def _locked(directory: Path, how: int) -> Iterator[None]:
    descriptor = os.open(directory, os.O_RDONLY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, how)
        yield
    finally:
        os.close(descriptor)

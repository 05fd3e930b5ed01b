# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Access to the bytes of log files, which may be larger than the memory."""

from __future__ import annotations

import contextlib
import mmap
import os
from collections import OrderedDict
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import StorageError

#: Largest number of open files. Samples are read in order of time, and therefore from few files at a time.
_MAX_OPEN = 16
#: Number of bytes after which the pages of a file that is read sequentially are released.
_RELEASE_BYTES = 64 << 20


class LogFiles:
    """Reader of parts of several files, which are opened as needed."""

    def __init__(self, files: list[Path]) -> None:
        self._files = files
        self._open: OrderedDict[int, BinaryIO] = OrderedDict()

    def read(self, file: int, start: int, end: int) -> bytes:
        """Return the bytes ``start`` to ``end`` of a file; raises StorageError if the file is shorter."""
        handle = self._open.pop(file, None)
        try:
            if handle is None:
                handle = self._files[file].open("rb", buffering=0)
            self._open[file] = handle
            if len(self._open) > _MAX_OPEN:
                self._open.popitem(last=False)[1].close()
            data = os.pread(handle.fileno(), end - start, start)
        except OSError as error:
            raise StorageError(f"log {self._files[file]}: {error}") from error
        if len(data) != end - start:
            raise StorageError(f"log {self._files[file]}: it became shorter while it was read")
        return data

    def close(self) -> None:
        """Close the files."""
        while self._open:
            self._open.popitem()[1].close()


class MappedFile:
    """A memory-mapped file that is read sequentially; ``data`` are its bytes."""

    def __init__(self, mapped: mmap.mmap) -> None:
        self._mapped = mapped
        self._released = 0
        self.data: NDArray[np.uint8] = np.frombuffer(mapped, dtype=np.uint8)

    def release_before(self, offset: int) -> None:
        """Release the memory of the pages before an offset."""
        if offset - self._released >= _RELEASE_BYTES:
            end = offset - offset % mmap.PAGESIZE
            self._mapped.madvise(mmap.MADV_DONTNEED, self._released, end - self._released)
            self._released = end


@contextlib.contextmanager
def mapped_file(path: Path) -> Iterator[MappedFile]:
    """Map a file that is not empty into memory."""
    with path.open("rb") as handle:
        mapped = mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ)
    file = MappedFile(mapped)
    try:
        yield file
    finally:
        del file.data
        # The traceback of an error may still refer to the data: close() then raises BufferError, and the
        # file is closed when the error is freed.
        with contextlib.suppress(BufferError):
            mapped.close()

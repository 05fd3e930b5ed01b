# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Octets of the files of a log, without keeping them in memory: a log may be larger than that."""

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

#: Files that are open at a time: samples come in the order of time, and so from few files at a time.
_MOST_OPEN = 16
#: Pages of a file that is read in order are released after this many bytes.
_RELEASE_BYTES = 64 << 20


class LogFiles:
    """Parts of several files, read one by one."""

    def __init__(self, files: list[Path]) -> None:
        self._files = files
        self._open: OrderedDict[int, BinaryIO] = OrderedDict()

    def read(self, file: int, begin: int, end: int) -> bytes:
        """Return the octets ``begin`` to ``end`` of a file; raises StorageError if the file is shorter."""
        handle = self._open.pop(file, None)
        try:
            if handle is None:
                handle = self._files[file].open("rb", buffering=0)
            self._open[file] = handle
            if len(self._open) > _MOST_OPEN:
                self._open.popitem(last=False)[1].close()
            data = os.pread(handle.fileno(), end - begin, begin)
        except OSError as error:
            raise StorageError(f"log {self._files[file]}: {error}") from error
        if len(data) != end - begin:
            raise StorageError(f"log {self._files[file]}: it became shorter while it was read")
        return data

    def close(self) -> None:
        """Close the files."""
        while self._open:
            self._open.popitem()[1].close()


class MappedFile:
    """A file in memory while it is read from start to end."""

    def __init__(self, mapped: mmap.mmap) -> None:
        self._mapped = mapped
        self._released = 0
        self.data: NDArray[np.uint8] = np.frombuffer(mapped, dtype=np.uint8)

    def passed(self, at: int) -> None:
        """Release the pages before ``at``."""
        if at - self._released >= _RELEASE_BYTES:
            end = at - at % mmap.PAGESIZE
            self._mapped.madvise(mmap.MADV_DONTNEED, self._released, end - self._released)
            self._released = end


@contextlib.contextmanager
def mapped_file(path: Path) -> Iterator[MappedFile]:
    """Map a file of at least one byte."""
    with path.open("rb") as handle:
        mapped = mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ)
    walk = MappedFile(mapped)
    try:
        yield walk
    finally:
        del walk.data
        # The traceback of an error may still refer to the data: close() then raises BufferError, and the
        # file is closed when the error is freed.
        with contextlib.suppress(BufferError):
            mapped.close()

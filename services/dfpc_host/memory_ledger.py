# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Number of products that a process has only in memory, in a file that can be changed on a full disk."""

from __future__ import annotations

import logging
import os
import struct
from pathlib import Path
from zlib import crc32

logger = logging.getLogger(__name__)

_COUNT = struct.Struct("<Q")
_SIZE = _COUNT.size + 4


class MemoryLedger:
    """A file of fixed size, overwritten in place, which needs no space on the disk.

    Parameters
    ----------
    path : Path
        The file; it is created unless the disk is already full.

    Attributes
    ----------
    previous : int
        Products that the previous process had only in memory when it ended: they are lost.
    """

    def __init__(self, path: Path) -> None:
        self.previous = 0
        self._path = path
        self._count = -1
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            self.previous = _read(path)
        except OSError as error:
            logger.warning("%s: not readable, losses of the previous process are unknown: %s", path, error)
        self.set(0)

    def set(self, count: int) -> None:
        """Note the present number; a failure of the disk is logged once."""
        if count == self._count:
            return
        data = _COUNT.pack(count)
        try:
            descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                os.pwrite(descriptor, data + struct.pack("<I", crc32(data)), 0)
            finally:
                os.close(descriptor)
        except OSError as error:
            if self._count >= 0:
                logger.warning("%s: the number of products in memory is not noted: %s", self._path, error)
        self._count = count


def _read(path: Path) -> int:
    """Return the number in a file; 0 without a file or with a damaged one."""
    data = path.read_bytes()[:_SIZE] if path.exists() else b""
    if len(data) != _SIZE or struct.unpack_from("<I", data, _COUNT.size)[0] != crc32(data[: _COUNT.size]):
        return 0
    return int(_COUNT.unpack_from(data)[0])

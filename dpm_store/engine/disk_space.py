# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Limits of the disk space: additions stop before the disk is full, and a reserve file allows deletions.

A deletion writes before it frees, because the database logs the pages that it changes; on a full disk nothing
could be deleted. Therefore additions are refused once less than ``low_water_bytes`` would remain, and a file
of ``reserve_bytes`` is removed during a deletion if other programs have filled the disk.
"""

from __future__ import annotations

import logging
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from cdff_common.errors import StorageError

logger = logging.getLogger(__name__)

#: Free space below which the reserve is removed when a store is opened; free space that additions leave.
RESERVE_BYTES = 4 << 20
LOW_WATER_BYTES = 64 << 20
_NAME = "store.reserve"


class DiskSpace:
    """Free space on the disk of a store.

    Parameters
    ----------
    directory : Path
    low_water_bytes : int
        Space that additions must leave.
    reserve_bytes : int
        Size of the reserve file for deletions on a full disk; 0 for no file.
    """

    def __init__(
        self, directory: Path, low_water_bytes: int = LOW_WATER_BYTES, reserve_bytes: int = 0
    ) -> None:
        self._directory = directory
        self._path = directory / _NAME
        self._low_water = low_water_bytes
        self._reserve = reserve_bytes
        self._lock = threading.Lock()
        self._deletions = 0
        if self.free_bytes() < max(reserve_bytes, RESERVE_BYTES):
            self._remove_reserve()  # opening a database also writes
        else:
            self._create_reserve()

    def free_bytes(self) -> int:
        """Return the bytes that can still be written on the file system of the store."""
        status = os.statvfs(self._directory)
        return status.f_bavail * status.f_frsize

    def is_low(self) -> bool:
        """Return whether additions are refused, or will be soon."""
        return self.free_bytes() < 2 * self._low_water

    def holds(self, payload_bytes: int) -> bool:
        """Return whether there is space for payloads of this size."""
        return self.free_bytes() - payload_bytes >= self._low_water

    def admit(self, payload_bytes: int) -> None:
        """Raise StorageError if payloads of this size would leave less than the low water."""
        if not self.holds(payload_bytes):
            raise StorageError(
                f"{payload_bytes} bytes not stored: the disk has {self.free_bytes()} left and "
                f"{self._low_water} are kept for deleting; delete products, or run `cdff dpm "
                "retention --apply`"
            )

    @contextmanager
    def deletion(self) -> Iterator[None]:
        """Release the reserve for a deletion if the disk is nearly full, and create it again afterwards."""
        with self._lock:
            self._deletions += 1
            if self.free_bytes() < self._low_water:
                self._remove_reserve()
        try:
            yield
        finally:
            with self._lock:
                self._deletions -= 1
                if self._deletions == 0:
                    self._create_reserve()

    def _create_reserve(self) -> None:
        """Create the reserve file unless it exists or the disk is nearly full; a failure is logged."""
        is_full = self.free_bytes() < self._low_water // 2 + self._reserve
        if not self._reserve or self._path.exists() or is_full:
            return
        try:
            descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                os.posix_fallocate(descriptor, 0, self._reserve)
            finally:
                os.close(descriptor)
        except OSError as error:
            self._remove_reserve()
            logger.warning(
                "no reserve for a full disk", extra={"path": str(self._path), "why": error.strerror}
            )

    def _remove_reserve(self) -> None:
        self._path.unlink(missing_ok=True)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Room on the disk: what would fill it is refused in time, and a reserve lets deletions work where it is full.

A deletion writes before it frees (SQLite's log takes the pages it changes), so that on a full disk nothing could be
deleted. Two things prevent that: additions are refused once less than ``low_water_bytes`` would be left, and a file of
``reserve_bytes`` is given up for as long as a deletion needs it, should others have filled the disk nevertheless.
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

RESERVE_BYTES = 4 << 20
LOW_WATER_BYTES = 64 << 20
_NAME = "store.reserve"


class Room:
    """What is left on the disk of a store.

    Parameters
    ----------
    directory : Path
    low_water_bytes : int
        Additions must leave so much.
    reserve_bytes : int
        Kept in a file for deletions on a full disk; 0 for none.
    """

    def __init__(self, directory: Path, low_water_bytes: int = LOW_WATER_BYTES, reserve_bytes: int = 0) -> None:
        self._directory = directory
        self._path = directory / _NAME
        self._low_water = low_water_bytes
        self._reserve = reserve_bytes
        self._lock = threading.Lock()
        self._freeing = 0
        if self.free_bytes() < max(reserve_bytes, RESERVE_BYTES):
            self._give_up()  # opening a database writes too
        else:
            self._take()

    def free_bytes(self) -> int:
        """Bytes that may still be written on the file system of the store."""
        found = os.statvfs(self._directory)
        return found.f_bavail * found.f_frsize

    def is_low(self) -> bool:
        """Tell whether additions are refused, or soon will be."""
        return self.free_bytes() < 2 * self._low_water

    def holds(self, wanted_bytes: int) -> bool:
        """Tell whether there is room for so many bytes of payloads."""
        return self.free_bytes() - wanted_bytes >= self._low_water

    def admit(self, wanted_bytes: int) -> None:
        """Let an addition pass, or refuse it while there is still room to delete.

        Parameters
        ----------
        wanted_bytes : int
            Of payloads.

        Raises
        ------
        StorageError
            If less than the low water would be left.
        """
        if not self.holds(wanted_bytes):
            raise StorageError(
                f"{wanted_bytes} bytes not stored: the disk has {self.free_bytes()} left and {self._low_water} are "
                "kept for deleting; delete products, or let `cdff dpm retention --apply` do it"
            )

    @contextmanager
    def freeing(self) -> Iterator[None]:
        """While a deletion runs: the reserve is given up where the disk is nearly full, and taken again afterwards."""
        with self._lock:
            self._freeing += 1
            if self.free_bytes() < self._low_water:
                self._give_up()
        try:
            yield
        finally:
            with self._lock:
                self._freeing -= 1
                if self._freeing == 0:
                    self._take()

    def _take(self) -> None:
        if not self._reserve or self._path.exists() or self.free_bytes() < self._low_water // 2 + self._reserve:
            return
        try:
            descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_CLOEXEC, 0o600)
            try:
                os.posix_fallocate(descriptor, 0, self._reserve)
            finally:
                os.close(descriptor)
        except OSError as error:
            self._path.unlink(missing_ok=True)
            logger.warning("no reserve for a full disk", extra={"path": str(self._path), "why": error.strerror})

    def _give_up(self) -> None:
        self._path.unlink(missing_ok=True)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The lock on a data directory: one process has the store open, every other is told so."""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from cdff_common.errors import UnavailableError

_NAME = "store.lock"


class DirectoryLock:
    """An advisory lock on a directory, held until ``release`` or the end of the process.

    Raises
    ------
    UnavailableError
        If another process holds it; the message names its process id.
    """

    def __init__(self, directory: Path) -> None:
        self._descriptor = os.open(directory / _NAME, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o600)
        try:
            fcntl.flock(self._descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            holder = os.read(self._descriptor, 32).decode("ascii", "replace").strip() or "unknown"
            os.close(self._descriptor)
            raise UnavailableError(
                f"data directory {directory}: in use by process {holder}; only one DPM opens it at a time"
            ) from error
        os.ftruncate(self._descriptor, 0)
        os.pwrite(self._descriptor, f"{os.getpid()}\n".encode(), 0)

    def release(self) -> None:
        """Let the next process have the directory."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1

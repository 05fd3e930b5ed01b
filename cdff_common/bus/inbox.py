# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bound of the payloads that a process holds for calls that it has not answered."""

from __future__ import annotations

import threading

#: Payloads of all unanswered calls together, bytes.
CAPACITY_BYTES = 128 << 20


class Inbox:
    """Payloads of the calls of one process.

    A payload is accepted as long as those before it do not exceed the capacity, so that large payloads are
    not refused because of many small ones. The payloads exceed the capacity by one at most.
    """

    def __init__(self, capacity: int = CAPACITY_BYTES) -> None:
        self._capacity, self._used = capacity, 0
        self._lock = threading.Lock()

    def take(self, nbytes: int) -> bool:
        """Accept a payload; return whether there was space for it."""
        with self._lock:
            if nbytes and self._used >= self._capacity:
                return False
            self._used += nbytes
            return True

    def release(self, nbytes: int) -> None:
        """Remove a payload that was accepted."""
        with self._lock:
            self._used -= nbytes

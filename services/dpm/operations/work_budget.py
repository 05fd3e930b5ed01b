# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One budget of memory for the requests of all interfaces of the DPM.

An operation states the memory that it is going to need before it allocates it. It then waits for its turn
for a limited time; if too many wait, or the time is over, the request is refused as OVERLOADED. Requests are
admitted in the order of their arrival, insertions before all others: a stream of small reads would otherwise
keep a large product of a robot out of the store until its outbox is full. A request waits at most once, so
that no two requests wait for each other.
"""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass

from cdff_common.clock import monotonic_s
from cdff_common.errors import OverloadedError
from cdff_common.memory import release_memory
from dpm_store.engine.time_limit import time_limit

#: Memory of all requests together, bytes.
TOTAL_BYTES = 480 << 20
#: Largest number of waiting requests of each kind, since each one occupies a thread, and their longest wait,
#: seconds.
MAX_WAITING, WAIT_S = 8, 8.0
_RETRY_S = 3.0
#: Longest time of a request, seconds, including its wait: its client has given up before.
LONGEST_S = 300.0
#: After requests with more memory than this, freed memory is returned to the system.
_LARGE_BYTES = 16 << 20


@dataclass(slots=True, eq=False)
class _Charge:
    """Memory of one request, bytes."""

    nbytes: int = 0


_CURRENT: ContextVar[_Charge | None] = ContextVar("charge", default=None)


class WorkBudget:
    """Memory that requests in progress may use.

    Parameters
    ----------
    total_bytes : int
        A request that needs more is carried out alone.
    max_waiting, wait_s : int, float
        Number of waiting insertions, and of other waiting requests, and their longest wait.
    """

    def __init__(
        self, total_bytes: int = TOTAL_BYTES, max_waiting: int = MAX_WAITING, wait_s: float = WAIT_S
    ) -> None:
        self._total = total_bytes
        self._max_waiting, self._wait_s = max_waiting, wait_s
        self._changed = threading.Condition()
        self._used = 0
        self._queues: dict[bool, deque[object]] = {True: deque(), False: deque()}
        self._was_used = False
        self.refused = 0

    @contextmanager
    def request(self) -> Iterator[None]:
        """Limit the time of the enclosed request, and release its charges at its end."""
        charge = _Charge()
        token = _CURRENT.set(charge)
        try:
            with time_limit(LONGEST_S):
                yield
        finally:
            _CURRENT.reset(token)
            self._reduce_to(charge, 0)

    def charge(self, nbytes: int, *, is_insertion: bool = False) -> None:
        """Charge the current request for memory; outside of a request nothing is charged.

        Raises
        ------
        OverloadedError
            If the budget is used by others for too long, or too many requests wait.
        """
        charge, needed = _CURRENT.get(), min(nbytes, self._total)
        if charge is None:
            return
        with self._changed:
            if charge.nbytes:  # it does not wait again
                self._used += max(needed - charge.nbytes, 0)
                charge.nbytes = max(needed, charge.nbytes)
                return
            if not self._is_next(needed, is_insertion):
                self._wait(needed, is_insertion)
            self._used += needed
            charge.nbytes = needed

    def keep(self, nbytes: int) -> None:
        """Reduce the charge of the current request to the memory that its answer needs."""
        charge = _CURRENT.get()
        if charge is not None:
            self._reduce_to(charge, nbytes)

    def return_freed_memory(self, *, is_freed: bool = False) -> None:
        """Return freed memory to the system after requests that have used some, or if ``is_freed``."""
        with self._changed:
            was_used, self._was_used = self._was_used, False
        if was_used or is_freed:
            release_memory()

    def _is_next(self, needed: int, is_insertion: bool, ticket: object | None = None) -> bool:
        """Return whether a request, with its ticket if it waits, is next and fits; the lock is held."""
        queue = self._queues[is_insertion]
        is_first = not queue or queue[0] is ticket
        return is_first and (is_insertion or not self._queues[True]) and self._used + needed <= self._total

    def _wait(self, needed: int, is_insertion: bool) -> None:
        """Wait for memory; the lock is held."""
        queue, ticket, until_s = self._queues[is_insertion], object(), monotonic_s() + self._wait_s
        if len(queue) >= self._max_waiting:
            raise self._refusal(needed)
        queue.append(ticket)
        try:
            while not self._is_next(needed, is_insertion, ticket):
                remaining_s = until_s - monotonic_s()
                if remaining_s <= 0.0:
                    raise self._refusal(needed)
                self._changed.wait(remaining_s)
        finally:
            queue.remove(ticket)
            self._changed.notify_all()

    def _refusal(self, needed: int) -> OverloadedError:
        """Count a refusal and return its error."""
        self.refused += 1
        return OverloadedError(
            f"{needed >> 20} MB are needed, other requests use {self._used >> 20} of {self._total >> 20} MB; "
            "repeat the request later, or ask for less",
            _RETRY_S,
        )

    def _reduce_to(self, charge: _Charge, remaining_bytes: int) -> None:
        """Reduce a charge, never increase it, and wake the waiting requests."""
        with self._changed:
            freed = max(charge.nbytes - remaining_bytes, 0)
            charge.nbytes -= freed
            self._used -= freed
            if freed:
                self._was_used = True
                self._changed.notify_all()
        if freed > _LARGE_BYTES:
            release_memory()

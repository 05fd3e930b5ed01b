# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shared DPM queries of equivalent requests: one request queries, the others use its result.

Equivalent requests share DFPCs through their leases; without shared queries, each would query at every
insertion.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import lru_cache

from cdff_common.bus import Pause, Signal
from cdff_common.clock import Clock
from cdff_common.errors import DeadlineError, UnavailableError
from cdff_core.orchestration.acceptance import Assessment, assess
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.timing import REAL, Timing

#: Result of a query: the best match, and its unmet requirements or why there is none.
Result = tuple[tuple[ProductMatch, Assessment] | None, str]


@dataclass(slots=True)
class _SharedQuery:
    """Last query of equivalent requests.

    Attributes
    ----------
    users : int
        Open requests.
    insertions, start_s
        Number of products inserted before it, and its start (monotonic seconds).
    is_running : bool
        True while a request executes the next one.
    waiting : list of Signal
        Set when it has ended.
    """

    users: int = 0
    insertions: int = -1
    start_s: float = float("-inf")
    result: Result | UnavailableError | None = None
    is_running: bool = False
    waiting: list[Signal] = field(default_factory=list)

    def result_since(self, insertions: int, start_s: float) -> Result | UnavailableError | None:
        """Return the last result if its query began at or after ``start_s`` (monotonic seconds) and after at
        least ``insertions`` insertions; else None.
        """
        return self.result if self.insertions >= insertions and self.start_s >= start_s else None

    def set_result(self, result: Result | UnavailableError, insertions: int, start_s: float) -> None:
        """Set the result of a query that began after some insertions."""
        self.result, self.insertions, self.start_s = result, insertions, start_s

    def begin(self, timing: Timing) -> Signal | None:
        """Mark the query as running; if it is running already, return a signal of its end."""
        if not self.is_running:
            self.is_running = True
            return None
        ended = timing.signal()
        self.waiting.append(ended)
        return ended


class SharedQueries:
    """Last query results of open requests, one for each distinct ``query_key``."""

    def __init__(self, clock: Clock, timing: Timing = REAL) -> None:
        self._clock = clock
        self._timing = timing
        self._lock = timing.lock()
        self._queries: dict[Hashable, _SharedQuery] = {}

    @contextmanager
    def share(self, request: ProductRequest) -> Iterator[None]:
        """Share the queries of a request; the last request removes the entry."""
        key = query_key(request)
        with self._lock:
            query = self._queries.setdefault(key, _SharedQuery())
            query.users += 1
        try:
            yield
        finally:
            with self._lock:
                query.users -= 1
                if query.users == 0:
                    del self._queries[key]

    def find(
        self,
        request: ProductRequest,
        execute: Callable[[], Result],
        insertions: int,
        max_age_s: float,
        until_s: float,
    ) -> Generator[Pause, None, Result]:
        """Yield pauses while another request queries, then return a result.

        It is the shared one since ``insertions`` and at most ``max_age_s`` old, else that of ``execute()``.

        Raises
        ------
        UnavailableError
            As raised by ``execute``, for all waiting requests.
        DeadlineError
            If the query of another request lasts past ``until_s``.
        """
        with self._lock:
            query = self._queries[query_key(request)]
        while True:
            with self._lock:
                now_s = self._timing.now_s()
                # The others that waited for it take the result: none of them begins before it is checked.
                result = query.result_since(insertions, now_s - max_age_s)
                ended = None if result is not None else query.begin(self._timing)
            if result is not None:
                return self._reassessed(request, result)
            if ended is None:
                break
            remaining_s = until_s - now_s
            if remaining_s <= 0.0:
                raise DeadlineError("no reply to an equivalent request yet")
            yield Pause(ended, remaining_s)
        try:
            executed = execute()
        except DeadlineError:  # the limit of this request, not of the others
            raise
        except UnavailableError as error:
            query.set_result(error, insertions, now_s)
            raise
        else:
            query.set_result(executed, insertions, now_s)
            return executed
        finally:
            self._end(query)

    def _end(self, query: _SharedQuery) -> None:
        with self._lock:
            query.is_running = False
            waiting, query.waiting = query.waiting, []
        for ended in waiting:
            ended.set()

    def _reassessed(self, request: ProductRequest, result: Result | UnavailableError) -> Result:
        """Return a result assessed at the current time."""
        if isinstance(result, UnavailableError):
            raise UnavailableError(str(result))
        if result[0] is None:
            return result
        match = result[0][0]
        assessment = assess(match.candidate, request, self._clock.now_ns())
        return (match, assessment), assessment.unmet

    def __len__(self) -> int:
        return len(self._queries)


@lru_cache(maxsize=4096)
def query_key(request: ProductRequest) -> Hashable:
    """Return the part of a request that determines the product; equal for equivalent requests."""
    # A pose is queried in its frame; other products are converted afterwards.
    frame = request.frame if request.product == "pose" else ""
    return replace(
        request,
        id="",
        deadline_s=0.0,
        priority=0,
        type_name="",
        format="",
        deliver="",
        frame=frame,
        every_s=None,
        progress=True,
    )

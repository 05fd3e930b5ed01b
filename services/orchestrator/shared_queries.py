# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shared DPM queries of equivalent requests: one request queries, the others use its result.

Equivalent requests share DFPCs through their leases; without shared queries, each would query at every
insertion.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

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

    ``insertions`` is the number of products inserted before it, ``start_s`` its start (monotonic seconds).
    """

    lock: threading.Lock
    users: int = 0
    insertions: int = -1
    start_s: float = float("-inf")
    result: Result | UnavailableError | None = None


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
            query = self._queries.setdefault(key, _SharedQuery(self._timing.lock()))
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
    ) -> Result:
        """Return a shared result since ``insertions`` and at most ``max_age_s`` old, else ``execute()``.

        Raises
        ------
        UnavailableError
            As raised by ``execute``, for all waiting requests.
        DeadlineError
            If the query of another request lasts past ``until_s``.
        """
        with self._lock:
            query = self._queries[query_key(request)]
        if not query.lock.acquire(timeout=max(until_s - self._timing.now_s(), 0.0)):
            raise DeadlineError("no reply to an equivalent request yet")
        try:
            now_s = self._timing.now_s()
            if (
                query.result is not None
                and query.insertions >= insertions
                and now_s - query.start_s <= max_age_s
            ):
                return self._reassessed(request, query.result)
            try:
                result = execute()
            except DeadlineError:  # the limit of this request, not of the others
                raise
            except UnavailableError as error:
                query.result, query.insertions, query.start_s = error, insertions, now_s
                raise
            query.result, query.insertions, query.start_s = result, insertions, now_s
            return result
        finally:
            query.lock.release()

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

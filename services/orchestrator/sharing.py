# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Identical requests look into the DPM together: one asks, the others take what it found.

They share the production by holding the same DFPCs (``leases``); this spares them the looking, which would otherwise
come once for each of them at every insertion.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace

from cdff_common.clock import Clock
from cdff_common.errors import DeadlineError, UnavailableError
from cdff_core.orchestration.judge import Judgement, judge
from cdff_core.orchestration.request import ProductRequest
from services.orchestrator.finder import Found
from services.orchestrator.timing import REAL, Timing

#: What one look brings: the best candidate and why there is no better one.
Result = tuple[tuple[Found, Judgement] | None, str]


@dataclass(slots=True)
class _Look:
    """The last look of those who wish the same.

    ``inserted`` is how many products had been inserted before it, ``at_s`` when it began (monotonic).
    """

    lock: threading.Lock
    users: int = 0
    inserted: int = -1
    at_s: float = float("-inf")
    result: Result | UnavailableError | None = None


class SharedLooks:
    """What open requests last found, one entry for each distinct wish; bounded by the number of open requests."""

    def __init__(self, clock: Clock, timing: Timing = REAL) -> None:
        self._clock = clock
        self._timing = timing
        self._lock = timing.lock()
        self._looks: dict[Hashable, _Look] = {}

    @contextmanager
    def joined(self, request: ProductRequest) -> Iterator[None]:
        """Take part; the entry goes with the last one who does."""
        key = wish(request)
        with self._lock:
            look = self._looks.setdefault(key, _Look(self._timing.lock()))
            look.users += 1
        try:
            yield
        finally:
            with self._lock:
                look.users -= 1
                if look.users == 0:
                    del self._looks[key]

    def find(
        self, request: ProductRequest, ask: Callable[[], Result], inserted: int, fresh_s: float, until_s: float
    ) -> Result:
        """Return what another one found since ``inserted`` and at most ``fresh_s`` ago, else ``ask()``.

        Raises
        ------
        UnavailableError
            As ``ask`` does, for all who wait for it.
        DeadlineError
            If another one's look lasts past ``until_s``.
        """
        with self._lock:
            look = self._looks[wish(request)]
        if not look.lock.acquire(timeout=max(until_s - self._timing.now_s(), 0.0)):
            raise DeadlineError("it has not answered an identical request yet")
        try:
            now_s = self._timing.now_s()
            if look.result is not None and look.inserted >= inserted and now_s - look.at_s <= fresh_s:
                return self._again(request, look.result)
            try:
                result = ask()
            except DeadlineError:  # its own time was up: that is nobody else's answer
                raise
            except UnavailableError as error:
                look.result, look.inserted, look.at_s = error, inserted, now_s
                raise
            look.result, look.inserted, look.at_s = result, inserted, now_s
            return result
        finally:
            look.lock.release()

    def _again(self, request: ProductRequest, result: Result | UnavailableError) -> Result:
        """What was found, judged by the clock of now."""
        if isinstance(result, UnavailableError):
            raise UnavailableError(str(result))
        if result[0] is None:
            return result
        found = result[0][0]
        judgement = judge(found.candidate, request, self._clock.now_ns())
        return (found, judgement), "; ".join([*judgement.missing, *judgement.short])

    def __len__(self) -> int:
        return len(self._looks)


def wish(request: ProductRequest) -> Hashable:
    """What two requests have in common that are answered from the same product."""
    # A pose is looked up in its frame; everything else is moved into it afterwards.
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

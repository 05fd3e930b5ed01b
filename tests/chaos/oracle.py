# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Record of the promises of a mission, and their comparison with the results.

Promises are insertions that the DPM acknowledged, products that a DFPC host published and queued in its
outbox, requests that were sent, and alarms of the disturbances.
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from cdff_common.clock import monotonic_s

#: A product on the bus is in the outbox of its host after this time, seconds.
QUEUED_S = 1.0
#: Bound of the resident memory of the DPM after the disturbances.
DPM_LIMIT_MB = 500.0
#: Time beyond its deadline in which a request must end, seconds.
ANSWER_MARGIN_S = 3.0


class Stored(NamedTuple):
    """Product in the DPM."""

    id: str
    robot: str
    dfpc: str
    port: str
    t1_ns: int


@dataclass(slots=True)
class _Request:
    name: str
    deadline_s: float
    started_s: float
    outcome: str = ""


@dataclass(slots=True)
class _ExpectedAlarm:
    kind: str
    source: str
    seen_s: float | None = None


@dataclass(slots=True)
class Oracle:
    """Promises of a mission; thread-safe.

    Attributes
    ----------
    violations : list of str
        Broken promises, one line each.
    """

    now_s: Callable[[], float] = monotonic_s
    violations: list[str] = field(default_factory=list)
    _lock: threading.Lock = field(default_factory=threading.Lock)
    _acknowledged: set[str] = field(default_factory=set)
    _published: dict[str, tuple[str, float]] = field(default_factory=dict)
    _interruptions: dict[str, list[float]] = field(default_factory=dict)
    _requests: list[_Request] = field(default_factory=list)
    _alarms: list[_ExpectedAlarm] = field(default_factory=list)

    def violate(self, text: str) -> None:
        """Add a broken promise."""
        with self._lock:
            self.violations.append(text)

    # -- products

    def acknowledge(self, product: str) -> None:
        """Record a product whose insertion the DPM acknowledged."""
        with self._lock:
            self._acknowledged.add(product)

    def publish(self, product: str, robot: str) -> None:
        """Record a product that a host published before it queued the product in its outbox."""
        with self._lock:
            self._published[product] = (robot, self.now_s())

    def interrupt(self, robot: str) -> None:
        """Record that the host of a robot is about to be stopped, possibly before a product is queued."""
        with self._lock:
            self._interruptions.setdefault(robot, []).append(self.now_s())

    def promised(self) -> set[str]:
        """Return the products that must be in the DPM at the end."""
        with self._lock:
            queued = {
                product
                for product, (robot, at_s) in self._published.items()
                if not any(abs(at_s - stop_s) < QUEUED_S for stop_s in self._interruptions.get(robot, ()))
            }
            return self._acknowledged | queued

    def check_products(self, stored: Collection[Stored]) -> None:
        """Compare the products in the DPM with the promised ones."""
        ids = Counter(product.id for product in stored)
        for product in sorted(self.promised() - ids.keys()):
            how = "acknowledged" if product in self._acknowledged else "queued in an outbox"
            self.violate(f"product {product}: {how} and lost")
        captures = Counter(product[1:] for product in stored)
        for name, count in [*ids.items(), *captures.items()]:
            if count > 1:
                self.violate(f"product {name}: stored {count} times")

    # -- requests

    def begin_request(self, name: str, deadline_s: float) -> int:
        """Record a request with its deadline in seconds from now; return its number."""
        with self._lock:
            self._requests.append(_Request(name, deadline_s, self.now_s()))
            return len(self._requests) - 1

    def end_request(self, number: int, outcome: str) -> None:
        """Record the result, or the name of the typed error, of a request."""
        request = self._requests[number]
        late_s = self.now_s() - request.started_s - request.deadline_s
        with self._lock:
            request.outcome = outcome
        if late_s > ANSWER_MARGIN_S:
            self.violate(f"request {request.name}: ended {late_s:.1f} s after its deadline with {outcome}")

    def check_requests(self) -> None:
        """Report the requests without an answer; to be called after the deadlines."""
        for request in self._requests:
            if not request.outcome:
                self.violate(f"request {request.name}: no answer within {request.deadline_s:g} s")

    # -- alarms

    def expect_alarm(self, kind: str, source: str, is_active: Callable[[], bool], within_s: float) -> None:
        """Wait until an alarm is active; report it as missed after ``within_s``."""
        expected = _ExpectedAlarm(kind, source)
        with self._lock:
            self._alarms.append(expected)
        start_s, pause = self.now_s(), threading.Event()
        while not is_active():
            if self.now_s() - start_s > within_s:
                self.violate(f"alarm {kind} of {source}: missed for {within_s:g} s")
                return
            pause.wait(0.2)
        expected.seen_s = self.now_s() - start_s

    # -- memory

    def check_memory(self, before_mb: Mapping[str, float], after_mb: Mapping[str, float]) -> None:
        """Compare the resident memory of the processes with that at the start."""
        for name, used_mb in after_mb.items():
            limit_mb = memory_limit_mb(name, before_mb[name])
            if used_mb > limit_mb:
                self.violate(f"memory of {name}: {used_mb:.0f} MB, expected at most {limit_mb:.0f} MB")

    def summary(self) -> dict[str, Any]:
        """Return the numbers of promises and the violations."""
        outcomes = Counter(request.outcome or "none" for request in self._requests)
        return {
            "products": {"acknowledged": len(self._acknowledged), "promised": len(self.promised())},
            "requests": {"sent": len(self._requests), "outcomes": dict(sorted(outcomes.items()))},
            "alarms": _alarm_summary(self._alarms),
            "violations": list(self.violations),
        }


def memory_limit_mb(service: str, before_mb: float) -> float:
    """Return the bound of a process: 500 MB for the DPM, 1.3 times the start for others.

    The others may have 30 MB more for their buffers, which are empty at the start.
    """
    return DPM_LIMIT_MB if service == "dpm" else 1.3 * before_mb + 30.0


def _alarm_summary(alarms: Iterable[_ExpectedAlarm]) -> dict[str, dict[str, Any]]:
    result: dict[str, dict[str, Any]] = {}
    for alarm in alarms:
        entry = result.setdefault(alarm.kind, {"expected": 0, "seen": 0, "longest_s": 0.0})
        entry["expected"] += 1
        if alarm.seen_s is not None:
            entry["seen"] += 1
            entry["longest_s"] = round(max(entry["longest_s"], alarm.seen_s), 1)
    return result

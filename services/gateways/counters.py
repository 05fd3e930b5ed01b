# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Counters of a topic and the limit of its rate."""

from __future__ import annotations

import math
import threading
from collections import Counter
from typing import Any

from cdff_common.clock import monotonic_s

#: Duration of a burst within the limit of the rate, seconds.
_BURST_S = 0.2
#: The least age is that of the messages of the last one to two of these intervals, seconds.
_AGE_INTERVAL_S = 10.0


class TopicCounters:
    """Messages of a topic: received, forwarded, dropped by reason; the last fault and the latency."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._forwarded = self._bytes = 0
        self._dropped: Counter[str] = Counter()
        self._last_fault = ""
        self._latency_ms = 0.0
        self._ages_ms: list[float] = []  # least of the previous and of the present interval
        self._age_since_s = -math.inf

    def receive(self, size: int) -> None:
        """Count a message with its bytes."""
        with self._lock:
            self._received += 1
            self._bytes += size

    def age(self, age_s: float, now_s: float | None = None) -> None:
        """Take the time between the stamp of a message and its arrival: delay and offset of the clocks.

        ``now_s`` is a monotonic time, by default now.
        """
        now_s = monotonic_s() if now_s is None else now_s
        with self._lock:
            passed_s = now_s - self._age_since_s
            if passed_s < _AGE_INTERVAL_S:
                self._ages_ms[-1] = min(self._ages_ms[-1], 1e3 * age_s)
                return
            previous = self._ages_ms[-1:] if passed_s < 2.0 * _AGE_INTERVAL_S else []
            self._ages_ms, self._age_since_s = [*previous, 1e3 * age_s], now_s

    def forward(self, latency_s: float) -> None:
        """Count a message that was sent on, and the time that the gateway took for it."""
        with self._lock:
            self._forwarded += 1
            self._latency_ms += (1e3 * latency_s - self._latency_ms) / min(self._forwarded, 100)

    def drop(self, reason: str, detail: str) -> bool:
        """Count a message that is not sent on; return True for the first with this reason."""
        with self._lock:
            self._dropped[reason] += 1
            self._last_fault = detail[:300]
            return self._dropped[reason] == 1

    def to_map(self) -> dict[str, Any]:
        """Return the counters as plain data; the latency is the mean of about the last 100 messages.

        ``least_age_ms`` is the least time between stamp and arrival of the messages of the last 10 to 20 s:
        the least delay, minus the time by which the clock of the robot is ahead.
        """
        with self._lock:
            return {
                "received": self._received,
                "forwarded": self._forwarded,
                "bytes": self._bytes,
                "dropped": dict(self._dropped),
                "last_fault": self._last_fault,
                "latency_ms": round(self._latency_ms, 3),
                "least_age_ms": round(min(self._ages_ms), 3) if self._ages_ms else None,
            }


class RateLimit:
    """Limit of a rate with bursts: the generic cell rate algorithm (ITU-T I.371).

    Parameters
    ----------
    max_hz : float
    """

    def __init__(self, max_hz: float) -> None:
        self._period_s, self._due_s = 1.0 / max_hz, 0.0

    def admits(self, now_s: float | None = None) -> bool:
        """Return True, and count the message, if one may pass at a monotonic time, by default now."""
        now_s = monotonic_s() if now_s is None else now_s
        if self._due_s - now_s > _BURST_S:
            return False
        self._due_s = max(self._due_s, now_s) + self._period_s
        return True

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Counters of a topic and the limit of its rate."""

from __future__ import annotations

import threading
from collections import Counter
from typing import Any

from cdff_common.clock import monotonic_s

#: Duration of a burst within the limit of the rate, seconds.
_BURST_S = 0.2
#: Rise of the least age with each message, so that it follows a clock that drifts, milliseconds.
_AGE_RISE_MS = 0.1


class TopicCounters:
    """Messages of a topic: received, forwarded, dropped by reason; the last fault and the latency."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._forwarded = self._bytes = 0
        self._dropped: Counter[str] = Counter()
        self._last_fault = ""
        self._latency_ms = 0.0
        self._age_ms: float | None = None

    def receive(self, size: int) -> None:
        """Count a message with its bytes."""
        with self._lock:
            self._received += 1
            self._bytes += size

    def age(self, age_s: float) -> None:
        """Take the time between the stamp of a message and its arrival: delay and offset of the clocks."""
        with self._lock:
            self._age_ms = (
                1e3 * age_s if self._age_ms is None else min(1e3 * age_s, self._age_ms + _AGE_RISE_MS)
            )

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

        ``least_age_ms`` is the least time between stamp and arrival of the last messages: the least delay,
        minus the time by which the clock of the robot is ahead.
        """
        with self._lock:
            return {
                "received": self._received,
                "forwarded": self._forwarded,
                "bytes": self._bytes,
                "dropped": dict(self._dropped),
                "last_fault": self._last_fault,
                "latency_ms": round(self._latency_ms, 3),
                "least_age_ms": None if self._age_ms is None else round(self._age_ms, 3),
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

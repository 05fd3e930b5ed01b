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


class TopicCounters:
    """Messages of a topic: received, forwarded, dropped by reason; the last fault and the latency."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received = self._forwarded = self._bytes = 0
        self._dropped: Counter[str] = Counter()
        self._last_fault = ""
        self._latency_ms = 0.0

    def receive(self, size: int) -> None:
        """Count a message with its bytes."""
        with self._lock:
            self._received += 1
            self._bytes += size

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
        """Return the counters as plain data; the latency is the mean of about the last 100 messages."""
        with self._lock:
            return {
                "received": self._received,
                "forwarded": self._forwarded,
                "bytes": self._bytes,
                "dropped": dict(self._dropped),
                "last_fault": self._last_fault,
                "latency_ms": round(self._latency_ms, 3),
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

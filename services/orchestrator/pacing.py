# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pace of a standing request: products at least a period of capture time apart, each as soon as it is stored.

Replies at fixed times would deliver a product that is made once a period up to one period late. The number of
replies is limited too, in case capture time runs faster than the clock: at most one in each period, and one
more.
"""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.clock import NS_PER_S

#: Fraction of a period by which a product may be early.
_EARLY = 0.1
_NEVER_NS = -1


@dataclass(slots=True)
class Pacing:
    """Times of the replies to one standing request.

    Attributes
    ----------
    period_s : float
        Least distance of the replies, seconds.
    sent : int
        Number of replies.
    """

    period_s: float
    sent: int = 0
    _last_t1_ns: int = _NEVER_NS
    _next_t1_ns: float = _NEVER_NS
    _next_s: float = float("-inf")

    def is_due(self, t1_ns: int, now_s: float) -> bool:
        """Return whether a product with an end of capture is due at a monotonic time."""
        is_newer = t1_ns > self._last_t1_ns and t1_ns >= self._next_t1_ns - _EARLY * self.period_s * NS_PER_S
        return is_newer and now_s >= self.earliest_s

    @property
    def earliest_s(self) -> float:
        """Earliest time of the next reply, monotonic seconds."""
        return self._next_s - self.period_s

    def add(self, t1_ns: int, now_s: float) -> None:
        """Record a reply with a product that is due."""
        period_ns = self.period_s * NS_PER_S
        self._last_t1_ns = t1_ns
        # A product that is late by more than a period starts a new sequence.
        follows = t1_ns - self._next_t1_ns < period_ns
        self._next_t1_ns = (self._next_t1_ns if self.sent and follows else t1_ns) + period_ns
        self._next_s = max(self._next_s, now_s) + self.period_s
        self.sent += 1

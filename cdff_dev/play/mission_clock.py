# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission clock of a player: it runs at a speed, and stands still while it is held."""

from __future__ import annotations

import threading

from cdff_common.clock import NS_PER_S, monotonic_s

#: A sample is waited for in steps of at most this, seconds, so that a clock that is held meanwhile is seen.
_STEP_S = 0.05


class Pace:
    """Mission time against the monotonic clock.

    Parameters
    ----------
    begin_ns : int
        Mission time at ``start``.
    speed : float
        Seconds of mission time per second, while it is not held.
    """

    def __init__(self, begin_ns: int, speed: float) -> None:
        self.speed = speed
        self._lock = threading.Lock()
        self._anchor_ns, self._anchor_s = begin_ns, monotonic_s()
        self._rate = 0.0
        self._stood_s = 0.0

    @property
    def rate(self) -> float:
        """Seconds of mission time per second, now."""
        return self._rate

    @property
    def held_s(self) -> float:
        """Time held since ``start``, seconds."""
        with self._lock:
            return self._stood_s + (monotonic_s() - self._anchor_s if self._rate == 0.0 else 0.0)

    def start(self) -> None:
        """Run from here on."""
        with self._lock:
            self._anchor_s, self._rate = monotonic_s(), self.speed

    def hold(self) -> None:
        """Stand still."""
        self._turn(0.0)

    def resume(self) -> None:
        """Run on."""
        self._turn(self.speed)

    def now_ns(self) -> int:
        """Mission time, a multiple of 1000 ns."""
        with self._lock:
            return self._at(monotonic_s())

    def late_s(self, stamp_ns: int) -> float:
        """Return the monotonic seconds since a mission time; negative before it."""
        return (self.now_ns() - stamp_ns) / NS_PER_S / self.speed

    def wait_until(self, stamp_ns: int, stop: threading.Event) -> bool:
        """Return True once it is ``stamp_ns``, False if ``stop`` is set before."""
        while (late_s := self.late_s(stamp_ns)) < 0.0:
            if stop.wait(min(-late_s, _STEP_S)):
                return False
        return not stop.is_set()

    def _turn(self, rate: float) -> None:
        with self._lock:
            if rate == self._rate:
                return
            now_s = monotonic_s()
            now_ns = self._at(now_s)
            if self._rate == 0.0:
                self._stood_s += now_s - self._anchor_s
            self._anchor_ns, self._anchor_s, self._rate = now_ns, now_s, rate

    def _at(self, now_s: float) -> int:
        return self._anchor_ns + int((now_s - self._anchor_s) * self._rate * 1e6) * 1000

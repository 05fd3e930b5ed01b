# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission clock of a player: it runs at a speed that can be changed, and can be held."""

from __future__ import annotations

import threading
from collections.abc import Callable

from cdff_common.clock import NS_PER_S, monotonic_s

#: Longest step of a wait, seconds: in each step it is checked whether the clock is held.
_STEP_S = 0.05


class Pace:
    """Mission time as a function of the monotonic clock.

    Parameters
    ----------
    start_ns : int
        Mission time when the clock is started.
    speed : float
        Seconds of mission time per second, while the clock is not held.
    """

    def __init__(self, start_ns: int, speed: float) -> None:
        self.speed = speed
        self._lock = threading.Lock()
        self._anchor_ns, self._anchor_s = start_ns, monotonic_s()
        self._rate = 0.0
        self._held_s = 0.0

    @property
    def rate(self) -> float:
        """Current rate: seconds of mission time per second, 0 while the clock is held."""
        return self._rate

    @property
    def held_s(self) -> float:
        """Total time for which the clock has been held since ``start``, seconds."""
        with self._lock:
            return self._held_s + (monotonic_s() - self._anchor_s if self._rate == 0.0 else 0.0)

    def start(self) -> None:
        """Start the clock."""
        with self._lock:
            self._anchor_s, self._rate = monotonic_s(), self.speed

    def hold(self) -> None:
        """Stop the clock until ``resume``."""
        self._set_rate(0.0)

    def resume(self) -> None:
        """Let a held clock run again."""
        self._set_rate(self.speed)

    def set_speed(self, speed: float) -> None:
        """Change the speed; a held clock stays held."""
        with self._lock:
            now_s = monotonic_s()
            self._anchor_ns, self._anchor_s = self._at(now_s), now_s
            self.speed, self._rate = speed, speed if self._rate else 0.0

    def advance_to(self, stamp_ns: int) -> None:
        """Set a held clock to a later mission time."""
        with self._lock:
            now_s = monotonic_s()
            if self._rate == 0.0:
                self._held_s += now_s - self._anchor_s
                self._anchor_ns, self._anchor_s = max(self._anchor_ns, stamp_ns), now_s

    def jump_to(self, stamp_ns: int) -> None:
        """Set the clock to any mission time; a running clock continues from there."""
        with self._lock:
            now_s = monotonic_s()
            if self._rate == 0.0:
                self._held_s += now_s - self._anchor_s
            self._anchor_ns, self._anchor_s = stamp_ns, now_s

    def now_ns(self) -> int:
        """Return the mission time, a multiple of 1000 ns."""
        with self._lock:
            return self._at(monotonic_s())

    def late_s(self, stamp_ns: int) -> float:
        """Return the seconds of real time since a mission time, negative before it."""
        return (self.now_ns() - stamp_ns) / NS_PER_S / self.speed

    def wait_until(
        self, stamp_ns: int, stop: threading.Event, is_interrupted: Callable[[], bool] = lambda: False
    ) -> bool:
        """Wait until mission time ``stamp_ns``; return False if ``stop`` is set or it is interrupted."""
        while (late_s := self.late_s(stamp_ns)) < 0.0 and not is_interrupted():
            if stop.wait(min(-late_s, _STEP_S)):
                return False
        return not (stop.is_set() or is_interrupted())

    def _set_rate(self, rate: float) -> None:
        """Set the rate of the clock from now on; 0 holds it."""
        with self._lock:
            if rate == self._rate:
                return
            now_s = monotonic_s()
            now_ns = self._at(now_s)
            if self._rate == 0.0:
                self._held_s += now_s - self._anchor_s
            self._anchor_ns, self._anchor_s, self._rate = now_ns, now_s, rate

    def _at(self, now_s: float) -> int:
        return self._anchor_ns + int((now_s - self._anchor_s) * self._rate * 1e6) * 1000

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mission time as published on ``cdff/@v1/ground/clock``, with checks of the published ticks."""

from __future__ import annotations

import logging
import math
import threading
from dataclasses import dataclass
from enum import StrEnum

from cdff_common.clock import NS_PER_S, monotonic_s, wall_ns
from cdff_common.errors import InputError

logger = logging.getLogger(__name__)

#: Largest rate of a mission clock: mission seconds in a second.
MAX_RATE = 1000.0
#: Latest mission time of a tick, the start of the year 2100; the earliest is 1970.
LATEST_TICK_NS = 4_102_444_800 * NS_PER_S
#: Largest jump of a tick that is accepted at once, mission seconds; plus two seconds at the clock's rate.
MAX_JUMP_S = 60.0
#: Time for which ticks must agree with each other until a larger jump is accepted, seconds.
CONFIRMATION_S = 2.0


class ClockState(StrEnum):
    """Source of mission time."""

    WALL = "wall"  # no clock was ever heard: the wall clock
    RUNNING = "running"
    LOST = "lost"  # the clock is silent: mission time is extrapolated


@dataclass(frozen=True, slots=True)
class _Tick:
    now_ns: int
    rate: float
    received_s: float

    def at(self, now_s: float) -> int:
        """Return the extrapolated mission time, a multiple of 1000 ns."""
        return (self.now_ns + int((now_s - self.received_s) * self.rate * NS_PER_S)) // 1000 * 1000

    def jump_s(self, other: _Tick) -> float:
        """Return the mission time of a later tick minus the extrapolated one, seconds; 0 if it is small."""
        jump_s = (other.now_ns - self.at(other.received_s)) / NS_PER_S
        return jump_s if abs(jump_s) > MAX_JUMP_S + 2.0 * max(self.rate, other.rate) else 0.0


class MissionClock:
    """Mission time, extrapolated at its rate from the last tick; the wall clock before the first tick.

    After ``timeout_s`` seconds without a tick the clock is lost, and the extrapolation continues. A tick that
    jumps further than ``MAX_JUMP_S`` is accepted when the ticks of ``CONFIRMATION_S`` seconds agree with it.
    """

    def __init__(self, timeout_s: float = 2.0) -> None:
        self._timeout_s = timeout_s
        self._lock = threading.Lock()
        self._tick: _Tick | None = None
        self._candidate: _Tick | None = None
        self._candidate_since_s = 0.0
        self._jumped_s = 0.0
        self._is_reported = False

    def on_tick(self, now_ns: int, rate: float) -> None:
        """Process a published tick: mission time ``now_ns`` and its rate.

        Raises
        ------
        InputError
            If the rate or the time is out of range, or the time jumps and the jump is not confirmed.
        """
        if type(now_ns) is not int or type(rate) not in (int, float):
            raise InputError(
                f"mission clock: now_ns={now_ns!r}, rate={rate!r}, expected an integer and a number"
            )
        if not (math.isfinite(rate) and 0.0 <= rate <= MAX_RATE):
            raise InputError(f"mission clock: rate {rate}, expected 0 to {MAX_RATE:g}")
        if not 0 <= now_ns <= LATEST_TICK_NS:
            raise InputError(f"mission clock: now_ns={now_ns}, expected 0 to {LATEST_TICK_NS} (1970 to 2100)")
        tick = _Tick(now_ns, rate, monotonic_s())
        with self._lock:
            jump_s = 0.0 if self._tick is None else self._tick.jump_s(tick)
            if jump_s and not self._is_confirmed(tick):
                raise InputError(
                    f"mission clock: a jump of {jump_s:.0f} s, which no other tick confirms yet; expected at "
                    f"most {MAX_JUMP_S:g} s"
                )
            self._jumped_s += jump_s
            self._tick, self._candidate, self._is_reported = tick, None, False

    def _is_confirmed(self, tick: _Tick) -> bool:
        """Return whether the ticks of the last ``CONFIRMATION_S`` agree with a tick that jumps."""
        previous, self._candidate = self._candidate, tick
        if previous is None or previous.jump_s(tick):
            self._candidate_since_s = tick.received_s
        return tick.received_s - self._candidate_since_s >= CONFIRMATION_S

    def now_ns(self) -> int:
        """Return mission time, nanoseconds, a multiple of 1000."""
        with self._lock:
            tick = self._tick
        if tick is None:
            return wall_ns()
        now_s = monotonic_s()
        if now_s - tick.received_s > self._timeout_s and not self._is_reported:
            self._is_reported = True
            logger.warning(
                "clock lost: no tick for %.1f s; mission time is extrapolated at rate %g",
                now_s - tick.received_s,
                tick.rate,
            )
        return tick.at(now_s)

    @property
    def state(self) -> ClockState:
        """Source of mission time."""
        with self._lock:
            tick = self._tick
        if tick is None:
            return ClockState.WALL
        is_lost = monotonic_s() - tick.received_s > self._timeout_s
        return ClockState.LOST if is_lost else ClockState.RUNNING

    @property
    def rate(self) -> float:
        """Mission seconds in a second."""
        with self._lock:
            return 1.0 if self._tick is None else self._tick.rate

    @property
    def jumped_s(self) -> float:
        """Sum of all accepted jumps since the start, seconds."""
        with self._lock:
            return self._jumped_s

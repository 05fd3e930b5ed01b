# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Checks of the stamps of one stream against the previous stamp and mission time."""

from __future__ import annotations

from dataclasses import dataclass

from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError


@dataclass(frozen=True, slots=True)
class ClockLimits:
    """Limits of the stamps of a sensor.

    Attributes
    ----------
    ahead_s : float
        Largest difference by which a stamp may be ahead of mission time, seconds.
    delay_s : float
        Largest age of a sample when it is published, seconds of mission time.
    """

    ahead_s: float = 0.1
    delay_s: float = 5.0

    def __post_init__(self) -> None:
        if not (self.ahead_s >= 0 and self.delay_s > 0):
            raise InputError(f"{self}: expected ahead_s of at least 0 and delay_s above 0")


@dataclass(frozen=True, slots=True)
class StampFault:
    """Fault of a stamp.

    Attributes
    ----------
    code : str
        ``stamp_backwards``, ``stamp_repeated``, ``stamp_ahead`` or ``stamp_late``.
    offset_s : float
        Time after the previous stamp or after mission time, seconds.
    advice : str
        Possible cause.
    """

    code: str
    offset_s: float
    advice: str

    @property
    def reason(self) -> str:
        """Reason for the quality of a sample, such as ``stamp_ahead:1.000s``."""
        return f"{self.code}:{self.offset_s:.3f}s"

    def __str__(self) -> str:
        reference = "the previous one" if self.code in _RELATIVE else "mission time"
        side = "after" if self.offset_s >= 0 else "before"
        return f"the stamp is {abs(self.offset_s):.3f} s {side} {reference}: {self.advice}"


_RELATIVE = frozenset({"stamp_backwards", "stamp_repeated"})


class StampMonitor:
    """Faults of the stamps of one stream.

    A jump of the mission clock, as by a player that continues at an earlier time, clears the previous stamp.
    """

    def __init__(self, limits: ClockLimits | None = None) -> None:
        self._limits = limits or ClockLimits()
        self._previous_ns: int | None = None
        self._jumped_s = 0.0

    def fault(self, stamp_ns: int, now_ns: int, jumped_s: float = 0.0) -> StampFault | None:
        """Return the fault of the next stamp of the stream; None if it has none.

        Parameters
        ----------
        stamp_ns, now_ns : int
            Stamp and mission time, nanoseconds.
        jumped_s : float
            Sum of all jumps of the mission clock, seconds.
        """
        if jumped_s != self._jumped_s:
            self._previous_ns, self._jumped_s = None, jumped_s
        previous_ns = self._previous_ns
        if previous_ns is not None and stamp_ns <= previous_ns:
            if stamp_ns == previous_ns:
                return StampFault("stamp_repeated", 0.0, "the device repeats a sample, or its clock stands")
            offset_s = (stamp_ns - previous_ns) / NS_PER_S
            return StampFault(
                "stamp_backwards", offset_s, "samples are out of order, or a clock was set back"
            )
        offset_s = (stamp_ns - now_ns) / NS_PER_S
        if offset_s > self._limits.ahead_s:
            advice = "synchronise the clock of the device, or stamp with `sensor.now_ns()`"
            return StampFault("stamp_ahead", offset_s, advice)  # not the reference of the next one
        self._previous_ns = stamp_ns
        if -offset_s > self._limits.delay_s:
            advice = "synchronise the clock of the device, or publish its samples earlier"
            return StampFault("stamp_late", offset_s, advice)
        return None

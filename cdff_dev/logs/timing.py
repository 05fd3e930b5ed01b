# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rate, gaps and irregular stamps of a stream."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

#: A gap is a step of more than this number of median periods.
_GAP_PERIODS = 3.0
#: Samples come in bursts if the rate by the median period is this multiple of the mean.
_BURST_RATIO = 100.0
#: A step forwards is a jump of the clock if it is longer than both.
_JUMP_PERIODS, _JUMP_S = 1000.0, 60.0


@dataclass(frozen=True, slots=True)
class Timing:
    """Steps between consecutive samples, in the order of writing.

    Attributes
    ----------
    duration_s : float
        From the smallest to the largest stamp.
    rate_hz : float
        Inverse of the median period; 0 without one.
    mean_rate_hz : float
        Steps by the duration; 0 without one.
    gaps : int
        Steps of more than 3 median periods.
    longest_gap_s : float
    longest_gap_at_ns : int
        Stamp before the longest gap; 0 without one.
    repeated, backwards : int
        Samples with the stamp of the previous one, and with an earlier stamp.
    clock_jumps : int
        Steps backwards by more than a median period, and forwards by more than 1000 of them and 60 s.
    """

    duration_s: float
    rate_hz: float
    mean_rate_hz: float
    gaps: int
    longest_gap_s: float
    longest_gap_at_ns: int
    repeated: int
    backwards: int
    clock_jumps: int

    @property
    def has_bursts(self) -> bool:
        """True if the median period is far below the mean one: that within bursts."""
        return self.rate_hz > _BURST_RATIO * self.mean_rate_hz


def timing(stamps_ns: NDArray[np.int64]) -> Timing:
    """Return the timing of stamps ``(n,)`` in the order of writing."""
    if len(stamps_ns) < 2:
        return Timing(0.0, 0.0, 0.0, 0, 0.0, 0, 0, 0, 0)
    steps_s = np.diff(stamps_ns) * 1e-9
    forwards = steps_s[steps_s > 0.0]
    period_s = float(np.median(forwards)) if len(forwards) else 0.0
    is_gap = steps_s > _GAP_PERIODS * period_s
    is_jump = (steps_s < -period_s) | (steps_s > max(_JUMP_PERIODS * period_s, _JUMP_S))
    longest = int(np.argmax(steps_s))
    duration_s = float(stamps_ns.max() - stamps_ns.min()) * 1e-9
    return Timing(
        duration_s=duration_s,
        rate_hz=1.0 / period_s if period_s else 0.0,
        mean_rate_hz=len(steps_s) / duration_s if duration_s else 0.0,
        gaps=int(is_gap.sum()),
        longest_gap_s=float(steps_s[longest]) if is_gap.any() else 0.0,
        longest_gap_at_ns=int(stamps_ns[longest]) if is_gap.any() else 0,
        repeated=int((steps_s == 0.0).sum()),
        backwards=int((steps_s < 0.0).sum()),
        clock_jumps=int(is_jump.sum()),
    )

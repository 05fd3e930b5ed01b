# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rate, lost samples and lead over the clock of one stream, compared with the profile."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from itertools import pairwise
from statistics import median, median_low
from typing import Any

from cdff_core.consistency.finding import CLOCK, SAMPLES, Finding
from cdff_core.consistency.limits import Limits

#: Number of the newest samples that are examined, and the least number of them.
_WINDOW, _LEAST_SAMPLES = 60, 20
#: Interval without samples after which the statistics start again: the sensor was off.
_PAUSE_NS = 5_000_000_000


class StreamStatistics:
    """The newest samples of one stream of a sensor.

    Parameters
    ----------
    sensor : str
        Name in the profile.
    entry : mapping
        Its entry in the profile: modes with their rates, and limits.
    limits : Limits
        Limits that the entry does not state.
    """

    def __init__(self, sensor: str, entry: Mapping[str, Any], limits: Limits) -> None:
        self.sensor = sensor
        modes = entry.get("modes", {}).values()
        self._stated_hz = sorted({m["rate_hz"] for m in modes if m.get("on", True) and m.get("rate_hz")})
        self._max_lost = _limit(entry, "max_lost_fraction", limits.lost_fraction)
        self._max_ratio = _limit(entry, "max_rate_ratio", limits.rate_ratio)
        self._max_offset_s = _limit(entry, "max_offset_s", limits.offset_s)
        self._samples: deque[tuple[int, int]] = deque(maxlen=_WINDOW)
        self._leads_s: deque[float] = deque(maxlen=_WINDOW)

    def add(self, stamp_ns: int, seq: int) -> None:
        """Add a sample; a repeated or older one, and a pause, start the statistics again."""
        if self._samples:
            last_ns, last_seq = self._samples[-1]
            if stamp_ns <= last_ns or seq <= last_seq or stamp_ns - last_ns > _PAUSE_NS:
                self._samples.clear()
        self._samples.append((stamp_ns, seq))

    def add_arrival(self, stamp_ns: int, now_ns: int) -> None:
        """Add the stamp of a sample that was received at mission time ``now_ns``."""
        self._leads_s.append((stamp_ns - now_ns) * 1e-9)

    @property
    def rate_hz(self) -> float | None:
        """Rate by the median interval, which lost samples do not change; None with too few samples."""
        steps = [(b[0] - a[0]) * 1e-9 for a, b in pairwise(list(self._samples))]
        return 1.0 / median(steps) if len(steps) >= _LEAST_SAMPLES - 1 else None

    @property
    def lost_fraction(self) -> float | None:
        """Fraction of the samples that are lost; None with too few samples.

        A mode with a lower rate may skip numbers regularly: only larger steps than the median are losses.
        """
        steps = [b[1] - a[1] for a, b in pairwise(list(self._samples))]
        if len(steps) < _LEAST_SAMPLES - 1:
            return None
        usual = median_low(steps)
        lost_samples = sum(max(round(step / usual) - 1, 0) for step in steps)
        return lost_samples / (lost_samples + len(steps) + 1)

    def findings(self) -> list[Finding]:
        """Return the differences from the profile."""
        return [f for f in (self._lost(), self._rate(), self._lead()) if f is not None]

    def _lost(self) -> Finding | None:
        """Return the finding about lost samples; None at or below the limit."""
        lost_fraction = self.lost_fraction
        if lost_fraction is None or lost_fraction <= self._max_lost:
            return None
        description = (
            f"{100.0 * lost_fraction:.0f} % of the samples of {self.sensor} are lost "
            "(gaps of their numbers), "
            f"expected at most {100.0 * self._max_lost:g} %"
        )
        remedy = f"check link, queue and processor load of {self.sensor}"
        return Finding(SAMPLES, (self.sensor,), f"{lost_fraction:.2f}_lost", description, remedy)

    def _rate(self) -> Finding | None:
        """Return the finding about a rate that no mode of the profile states; None without one."""
        rate = self.rate_hz
        if rate is None or not self._stated_hz:
            return None
        if any(r / self._max_ratio <= rate <= r * self._max_ratio for r in self._stated_hz):
            return None
        stated_rates = " or ".join(f"{r:g} Hz" for r in self._stated_hz)
        description = f"{self.sensor} sends {rate:.3g} Hz, the profile states {stated_rates}"
        remedy = f"correct rate_hz of the modes of {self.sensor} in the profile, or its driver"
        return Finding(SAMPLES, (self.sensor,), f"{rate:.3g}_hz", description, remedy)

    def _lead(self) -> Finding | None:
        """Return the finding about stamps ahead of the mission clock at their arrival; None within the
        limit.
        """
        leads = list(self._leads_s)
        if len(leads) < 3 or (lead_s := median(leads)) <= self._max_offset_s:
            return None
        description = (
            f"stamps of {self.sensor} are ahead of the mission clock by {lead_s:.1f} s at their arrival, "
            f"expected at most {self._max_offset_s:g} s"
        )
        remedy = f"synchronise the clock of {self.sensor} with the mission clock"
        return Finding(CLOCK, (self.sensor,), f"ahead_{lead_s:.1f}_s", description, remedy)


def _limit(entry: Mapping[str, Any], name: str, default: float) -> float:
    value = entry.get(name)
    return default if value is None else float(value)

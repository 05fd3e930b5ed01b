# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The last seconds of IMU readings, in the body's axes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray


@dataclass(slots=True)
class ImuBuffer:
    """Readings in rising order of time.

    Attributes
    ----------
    memory_ns : int
        How long a reading is kept at least, nanoseconds.
    """

    memory_ns: int
    stamps_ns: list[int] = field(default_factory=list)
    forces: list[FloatArray] = field(default_factory=list)
    rates: list[FloatArray] = field(default_factory=list)

    def append(self, stamp_ns: int, force_m_s2: FloatArray, rate_rad_s: FloatArray) -> bool:
        """Add a reading; False where it is not newer than the newest, and left out."""
        if self.stamps_ns and stamp_ns <= self.stamps_ns[-1]:
            return False
        self.stamps_ns.append(stamp_ns)
        self.forces.append(force_m_s2)
        self.rates.append(rate_rad_s)
        # Cut in blocks: a list is shortened from the front at the price of moving the rest.
        if stamp_ns - self.stamps_ns[0] > 2 * self.memory_ns:
            cut = bisect_left(self.stamps_ns, stamp_ns - self.memory_ns)
            del self.stamps_ns[:cut], self.forces[:cut], self.rates[:cut]
        return True

    @property
    def span_ns(self) -> int:
        """Time from the oldest to the newest reading, nanoseconds."""
        return self.stamps_ns[-1] - self.stamps_ns[0] if self.stamps_ns else 0

    def until(self, stamp_ns: int) -> tuple[FloatArray, FloatArray]:
        """Forces and rates ``(n, 3)`` of all readings up to a time."""
        cut = bisect_right(self.stamps_ns, stamp_ns)
        return np.array(self.forces[:cut]).reshape(-1, 3), np.array(self.rates[:cut]).reshape(-1, 3)

    def around(self, begin_ns: int, end_ns: int) -> tuple[NDArray[np.int64], FloatArray]:
        """Stamps ``(n,)`` and rates ``(n, 3)`` inside an interval and the one reading on either side of it."""
        first = max(bisect_left(self.stamps_ns, begin_ns) - 1, 0)
        last = bisect_right(self.stamps_ns, end_ns) + 1
        return np.array(self.stamps_ns[first:last], dtype=np.int64), np.array(self.rates[first:last]).reshape(-1, 3)

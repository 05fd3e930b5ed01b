# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The last seconds of IMU readings, in the base's axes."""

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
    readings : list of array, shape (6,)
        Specific force in m/s^2, then rate in rad/s.
    """

    memory_ns: int
    stamps_ns: list[int] = field(default_factory=list)
    readings: list[FloatArray] = field(default_factory=list)

    def insert(self, stamp_ns: int, reading: FloatArray) -> None:
        """Add a reading, where it belongs; one of a time that is there already is left out."""
        if not self.stamps_ns or stamp_ns > self.stamps_ns[-1]:
            self.stamps_ns.append(stamp_ns)
            self.readings.append(reading)
        else:
            k = bisect_left(self.stamps_ns, stamp_ns)
            if self.stamps_ns[k] != stamp_ns:
                self.stamps_ns.insert(k, stamp_ns)
                self.readings.insert(k, reading)
        # Cut in blocks: a list is shortened from the front at the price of moving the rest.
        if self.stamps_ns[-1] - self.stamps_ns[0] > 2 * self.memory_ns:
            cut = bisect_left(self.stamps_ns, self.stamps_ns[-1] - self.memory_ns)
            del self.stamps_ns[:cut], self.readings[:cut]

    @property
    def span_ns(self) -> int:
        """Time from the oldest to the newest reading, nanoseconds."""
        return self.stamps_ns[-1] - self.stamps_ns[0] if self.stamps_ns else 0

    def all(self) -> tuple[FloatArray, FloatArray]:
        """Forces and rates ``(n, 3)`` of all readings."""
        rows = np.array(self.readings).reshape(-1, 6)
        return rows[:, :3], rows[:, 3:]

    def around(self, begin_ns: int, end_ns: int) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Stamps ``(n,)``, forces and rates ``(n, 3)`` inside an interval and the one reading on either side of it."""
        first = max(bisect_right(self.stamps_ns, begin_ns) - 1, 0)
        last = bisect_left(self.stamps_ns, end_ns) + 1
        rows = np.array(self.readings[first:last]).reshape(-1, 6)
        return np.array(self.stamps_ns[first:last], dtype=np.int64), rows[:, :3], rows[:, 3:]

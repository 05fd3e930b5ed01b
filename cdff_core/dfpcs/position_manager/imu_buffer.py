# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Buffer of the latest IMU readings in the base's axes."""

from __future__ import annotations

from bisect import bisect_left, bisect_right

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry.se3 import FloatArray

#: Maximum and minimum number of readings from whose differences the noise is estimated.
_NOISE_READINGS, _MIN_NOISE_READINGS = 60, 20

#: Ratio of an interval to the median interval above which readings are missing in it.
_GAP = 1.8
#: Age of a reading up to which an IMU counts as present, nanoseconds.
_MAX_AGE_NS = 1_000_000_000


class ImuBuffer:
    """IMU readings in ascending order of time, each kept for at least ``memory_ns``."""

    def __init__(self, memory_ns: int) -> None:
        self._memory_ns = memory_ns
        self._stamps_ns: list[int] = []
        self._readings: list[FloatArray] = []
        #: Mount of the IMU; None until the first reading.
        self.T_base_imu: FloatArray | None = None

    @property
    def lever_m(self) -> FloatArray:
        """Position of the IMU (3,) in the base."""
        return np.zeros(3) if self.T_base_imu is None else self.T_base_imu[:3, 3]

    @property
    def span_ns(self) -> int:
        """Time from the oldest to the newest reading, nanoseconds."""
        return self._stamps_ns[-1] - self._stamps_ns[0] if self._stamps_ns else 0

    @property
    def newest_ns(self) -> int:
        """Time of the newest reading, nanoseconds; -1 without readings."""
        return self._stamps_ns[-1] if self._stamps_ns else -1

    def has_readings(self, start_ns: int, end_ns: int) -> bool:
        """Return whether there is a reading in an interval or shortly before it."""
        first = bisect_left(self._stamps_ns, start_ns - _MAX_AGE_NS)
        return first < bisect_right(self._stamps_ns, end_ns)

    def insert(self, stamp_ns: int, force_m_s2: FloatArray, rate_rad_s: FloatArray) -> None:
        """Insert specific force and rate (3,) in the axes of the IMU by time; repeated times are ignored."""
        assert self.T_base_imu is not None  # set by the caller before the first reading
        R = self.T_base_imu[:3, :3]
        stamps, reading = self._stamps_ns, np.concatenate([R @ force_m_s2, R @ rate_rad_s])
        k = bisect_left(stamps, stamp_ns)
        if k < len(stamps) and stamps[k] == stamp_ns:
            return
        stamps.insert(k, stamp_ns)
        self._readings.insert(k, reading)
        if self.span_ns > 2 * self._memory_ns:  # in blocks, since removal from the front moves all others
            start = bisect_left(stamps, stamps[-1] - self._memory_ns)
            del stamps[:start], self._readings[:start]

    def all(self) -> tuple[FloatArray, FloatArray]:
        """Return forces and rates (n, 3) of all readings."""
        rows = np.array(self._readings).reshape(-1, 6)
        return rows[:, :3], rows[:, 3:]

    def noise(self, end_ns: int) -> tuple[float | None, float | None]:
        """Return the noise densities of forces, m/s^2/sqrt(Hz), and rates, rad/s/sqrt(Hz), up to ``end_ns``.

        Both are None with too few readings. Half the mean square of the differences of successive readings is
        the variance of white noise; vibration contributes to it, slow motion hardly does.
        """
        last = bisect_right(self._stamps_ns, end_ns)
        first = max(last - _NOISE_READINGS, 0)
        if last - first < _MIN_NOISE_READINGS:
            return None, None
        differences = np.diff(np.array(self._readings[first:last]), axis=0)
        intervals_s = np.diff(self._stamps_ns[first:last]) * 1e-9
        is_successive = intervals_s < _GAP * np.median(intervals_s)
        period_s = float(np.mean(intervals_s[is_successive]))
        variance = 0.5 * np.mean(np.square(differences[is_successive]).reshape(-1, 2, 3), axis=(0, 2))
        force, rate = np.sqrt(variance * period_s)
        return float(force), float(rate)

    def around(self, start_ns: int, end_ns: int) -> tuple[NDArray[np.int64], FloatArray, FloatArray]:
        """Return stamps (n,), forces and rates (n, 3) of an interval and of one reading on either side."""
        first = max(bisect_right(self._stamps_ns, start_ns) - 1, 0)
        last = bisect_left(self._stamps_ns, end_ns) + 1
        rows = np.array(self._readings[first:last]).reshape(-1, 6)
        return np.array(self._stamps_ns[first:last], dtype=np.int64), rows[:, :3], rows[:, 3:]

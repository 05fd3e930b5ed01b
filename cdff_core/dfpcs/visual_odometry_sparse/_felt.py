# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion that wheels and gyro feel between two images: it tells where to look, not where the camera is."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import se3
from cdff_core.dfpcs.visual_odometry_sparse._state import FloatArray

#: Integrates rates about the gyro's axes: stamps ``(n,)``, rates ``(n, 3)``, begin, end -> ``R_imu1_imu2``.
Integrate = Callable[[list[int], list[FloatArray], int, int], FloatArray]
#: An odometry's last increment is taken to go on for so long, nanoseconds.
_AHEAD_NS = 300_000_000


@dataclass(slots=True)
class Felt:
    """The last seconds of odometry poses and angular rates.

    Attributes
    ----------
    integrate : callable
        The DFN that integrates angular rates; raises RefusedError where they leave a gap.
    memory_ns : int
        How long samples are kept, nanoseconds.
    T_left_base, R_left_imu : array or None
        The mounts, once they are known: without its mount a source says nothing.
    """

    integrate: Integrate
    memory_ns: int
    T_left_base: FloatArray | None = None
    R_left_imu: FloatArray | None = None
    _pose_stamps: list[int] = field(default_factory=list)
    _poses: list[FloatArray] = field(default_factory=list)
    _rate_stamps: list[int] = field(default_factory=list)
    _rates: list[FloatArray] = field(default_factory=list)

    def add_pose(self, stamp_ns: int, T_odom_base: FloatArray) -> None:
        """Take a pose of the wheels; one that does not come after the last is passed over."""
        self._add(self._pose_stamps, self._poses, stamp_ns, T_odom_base)

    def add_rate(self, stamp_ns: int, rate_rad_s: FloatArray) -> None:
        """Take an angular rate about the gyro's axes; one that does not come after the last is passed over."""
        self._add(self._rate_stamps, self._rates, stamp_ns, rate_rad_s)

    def increment(self, begin_ns: int, end_ns: int) -> tuple[FloatArray | None, FloatArray | None]:
        """Translation ``(3,)`` and rotation ``(3, 3)`` of ``T_left1_left2`` as they were felt; None where not.

        The rotation is the gyro's where there is one, else the wheels'. Translation is the wheels'.
        """
        T = self._of_wheels(begin_ns, end_ns)
        R = self._of_gyro(begin_ns, end_ns)
        if T is None:
            return None, R
        assert self.T_left_base is not None
        T_left_left = self.T_left_base @ T @ se3.inverse(self.T_left_base)
        if R is None:
            return T_left_left[:3, 3], T_left_left[:3, :3]
        # The camera's lever arm turns as the gyro says, not as the wheels do.
        T = T.copy()
        R_base_left = self.T_left_base[:3, :3].T
        T[:3, :3] = R_base_left @ R @ R_base_left.T
        return (self.T_left_base @ T @ se3.inverse(self.T_left_base))[:3, 3], R

    def _add(self, stamps: list[int], values: list[FloatArray], stamp_ns: int, value: FloatArray) -> None:
        if stamps and stamp_ns <= stamps[-1]:
            return
        stamps.append(stamp_ns)
        values.append(value)
        if stamps[-1] - stamps[0] > 2 * self.memory_ns:  # in blocks: the rest has to move
            cut = bisect_left(stamps, stamp_ns - self.memory_ns)
            del stamps[:cut], values[:cut]

    def _of_wheels(self, begin_ns: int, end_ns: int) -> FloatArray | None:
        """``T_base1_base2``; None where the poses do not reach from begin to end."""
        if self.T_left_base is None or len(self._poses) < 2:
            return None
        if begin_ns < self._pose_stamps[0] or end_ns > self._pose_stamps[-1] + _AHEAD_NS:
            return None
        return se3.inverse(self._pose_at(begin_ns)) @ self._pose_at(end_ns)

    def _pose_at(self, stamp_ns: int) -> FloatArray:
        k = min(max(bisect_right(self._pose_stamps, stamp_ns), 1), len(self._poses) - 1)
        t0, t1 = self._pose_stamps[k - 1], self._pose_stamps[k]
        step = se3.log_se3(se3.inverse(self._poses[k - 1]) @ self._poses[k])
        return self._poses[k - 1] @ se3.exp_se3(step * ((stamp_ns - t0) / (t1 - t0)))

    def _of_gyro(self, begin_ns: int, end_ns: int) -> FloatArray | None:
        """``R_left1_left2``; None where the rates leave a gap."""
        if self.R_left_imu is None or not self._rates:
            return None
        first = max(bisect_right(self._rate_stamps, begin_ns) - 1, 0)
        last = bisect_left(self._rate_stamps, end_ns) + 1
        try:
            R = self.integrate(self._rate_stamps[first:last], self._rates[first:last], begin_ns, end_ns)
        except RefusedError:
            return None
        return np.asarray(self.R_left_imu @ R @ self.R_left_imu.T, dtype=np.float64)

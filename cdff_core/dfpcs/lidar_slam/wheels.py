# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The motion between two sweeps as another odometry has it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import NS_PER_S
from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.frame_graph import PoseTrack

Float = NDArray[np.float64]

_KEPT_NS = 60 * NS_PER_S
#: Time over which the speed is taken that leads beyond the newest pose.
_SPEED_NS = NS_PER_S // 5


class Wheels:
    """Poses of an odometry; the end of a sweep is often a little newer than the newest of them.

    Parameters
    ----------
    age_s : float
        How much newer it may be: so far the motion goes on as it was.
    T_base_lidar : ndarray, shape (4, 4)
        The odometry is that of the base.
    """

    def __init__(self, age_s: float, T_base_lidar: Float) -> None:
        self._age_ns, self._mount = int(age_s * NS_PER_S), T_base_lidar
        self._track = PoseTrack()
        self._at_sweep: Float | None = None

    def take(self, stamp_ns: int, T_odom_base: UncertainTransform) -> None:
        """Keep a pose."""
        self._track.insert(stamp_ns, T_odom_base)
        self._track.forget_before(stamp_ns - _KEPT_NS)

    def since_last_sweep(self, stamp_ns: int) -> Float | None:
        """``T_before_now`` (4, 4) of the lidar since the sweep asked for before; None where a pose is not known.

        It begins where the step before ended, so that what was guessed beyond the newest pose does not add up.
        """
        before, self._at_sweep = self._at_sweep, self._pose(stamp_ns)
        if before is None or self._at_sweep is None:
            return None
        return se3.inverse(before @ self._mount) @ self._at_sweep @ self._mount

    def velocity(self, stamp_ns: int) -> Float | None:
        """Translation and rotation vector per second of the lidar in its own axes; None where not known."""
        before_ns = stamp_ns - _SPEED_NS
        before, now = self._pose(before_ns), self._pose(stamp_ns)
        if before is None or now is None:
            return None
        step = se3.inverse(before @ self._mount) @ now @ self._mount
        return np.concatenate([step[:3, 3], se3.log_so3(step[:3, :3])]) * (NS_PER_S / _SPEED_NS)

    def _pose(self, stamp_ns: int) -> Float | None:
        known = self._track.stamps_ns
        beyond_ns = stamp_ns - known[-1] if known else 0
        if not known or beyond_ns > self._age_ns:
            return None
        try:
            if beyond_ns <= 0:
                return self._track.at(stamp_ns).matrix
            before_ns = max(known[-1] - _SPEED_NS, known[0])
            before, last = self._track.at(before_ns).matrix, self._track.at(known[-1]).matrix
        except ExtrapolationError:
            return None
        if before_ns == known[-1]:
            return last
        step = se3.log_se3(se3.inverse(before) @ last)
        return np.asarray(last @ se3.exp_se3(step * (beyond_ns / (known[-1] - before_ns))))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recent poses of an odometry, and the motion between two times."""

from __future__ import annotations

import numpy as np

from cdff_common.errors import ExtrapolationError
from cdff_common.geometry import se3
from cdff_common.geometry.frame_graph import PoseTrack
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.uncertain_transform import UncertainTransform


class OdometryBuffer:
    """Poses ``T_odom_base`` of the last seconds, interpolated, and extrapolated at constant velocity.

    Sensor data are often a little newer than the newest odometry; for that time the motion continues with the
    twist of the last ``velocity_window_ns``.

    Parameters
    ----------
    memory_ns : int
        Age at which a pose is evicted, nanoseconds.
    extrapolation_limit_ns : int
        Largest distance of a requested time from the newest pose, nanoseconds.
    velocity_window_ns : int
        Time over which the velocity is computed, nanoseconds.

    See Also
    --------
    PoseTrack : Interpolation without extrapolation of the motion.
    """

    def __init__(
        self, memory_ns: int, extrapolation_limit_ns: int = 0, velocity_window_ns: int = 200_000_000
    ) -> None:
        self._memory_ns = memory_ns
        self._extrapolation_limit_ns = extrapolation_limit_ns
        self._velocity_window_ns = velocity_window_ns
        self._track = PoseTrack()

    @property
    def stamps_ns(self) -> list[int]:
        """Stamps of the buffered poses, ascending."""
        return self._track.stamps_ns

    def clear(self) -> None:
        """Remove all poses."""
        self._track = PoseTrack()

    def insert(self, stamp_ns: int, T_odom_base: UncertainTransform) -> None:
        """Add a pose and evict the old ones."""
        self._track.insert(stamp_ns, T_odom_base)
        self._track.evict_before(stamp_ns - self._memory_ns)

    def pose(self, stamp_ns: int) -> UncertainTransform | None:
        """Return ``T_odom_base`` at a time, or None if it is outside the covered time.

        Interpolated poses have a covariance if their neighbours have one, extrapolated poses have none.
        """
        if not self.stamps_ns:
            return None
        last_ns = self.stamps_ns[-1]
        ahead_ns = stamp_ns - last_ns
        if ahead_ns > self._extrapolation_limit_ns:
            return None
        try:
            if ahead_ns <= 0:
                return self._track.at(stamp_ns)
            window_ns = min(self._velocity_window_ns, last_ns - self.stamps_ns[0])
            last = self._track.at(last_ns).matrix
            if window_ns == 0:
                return UncertainTransform(last)
            step = se3.log_se3(se3.inverse(self._track.at(last_ns - window_ns).matrix) @ last)
        except ExtrapolationError:
            return None
        return UncertainTransform(last @ se3.exp_se3(step * (ahead_ns / window_ns)))

    def motion(self, start_ns: int, end_ns: int) -> FloatArray | None:
        """Return ``T_base(start)_base(end)``, shape (4, 4), or None if a time is outside the covered time."""
        start, end = self.pose(start_ns), self.pose(end_ns)
        return None if start is None or end is None else se3.inverse(start.matrix) @ end.matrix

    def velocity(self, stamp_ns: int) -> FloatArray | None:
        """Return translation and rotation vector per second, shape (6,), in axes of the base; None if
        unknown.

        It is the mean over ``velocity_window_ns`` before ``stamp_ns``.
        """
        step = self.motion(stamp_ns - self._velocity_window_ns, stamp_ns)
        if step is None:
            return None
        return np.asarray(se3.vector_from_transform(step) * (1e9 / self._velocity_window_ns))

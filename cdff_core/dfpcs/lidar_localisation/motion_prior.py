# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Motion between two times from odometry, or at constant velocity without odometry."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import OdometryBuffer, UncertainTransform, se3
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementInputs

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn
    from cdff_common.types import TransformWithCovariance
    from cdff_core.dfpcs.lidar_localisation.configuration import LidarLocalisationConfig

#: Time for which odometry is buffered.
_HISTORY_NS = 60_000_000_000
#: Standard deviations that each prediction adds, for translation and rotation.
_STEP_SIGMA_M, _STEP_SIGMA_DEG = 0.02, 0.3


class MotionPrior:
    """Odometry of the last minute (OdometryIncrement), and the last two poses of the localisation."""

    def __init__(self, increment: Dfn[Any, Any, Any], config: LidarLocalisationConfig) -> None:
        self._increment, self._config = increment, config
        self._odometry = OdometryBuffer(_HISTORY_NS)
        self._frames = ("", "")
        self._mount = np.eye(4)
        self._poses: list[tuple[int, se3.FloatArray]] = []

    def insert(self, stamp_ns: int, odometry: TransformWithCovariance, T_base_child: se3.FloatArray) -> None:
        """Add a pose of the odometry; a change of its frames clears the earlier poses."""
        frames = (odometry.parent_frame, odometry.child_frame)
        if frames != self._frames:
            self._odometry, self._frames = OdometryBuffer(_HISTORY_NS), frames
        self._mount = T_base_child
        self._odometry.insert(stamp_ns, odometry.transform)

    def add_pose(self, stamp_ns: int, T_map_base: se3.FloatArray) -> None:
        """Add a pose of the localisation; the last two define the velocity that is used without odometry."""
        self._poses = [*self._poses[-1:], (stamp_ns, T_map_base)]

    def clear_poses(self) -> None:
        """Remove the poses of the localisation, since the next one will not continue the last one."""
        self._poses = []

    @property
    def last_ns(self) -> int | None:
        """Stamp of the newest odometry; None without odometry."""
        return self._odometry.stamps_ns[-1] if self._odometry.stamps_ns else None

    def between(self, first_ns: int, second_ns: int) -> UncertainTransform:
        """Return ``T_first_second`` of the base between two times, with its covariance."""
        cfg = self._config
        sigma = np.repeat([_STEP_SIGMA_M, np.radians(_STEP_SIGMA_DEG)], 3)
        first, second = self._odometry.pose(first_ns), self._odometry.pose(second_ns)
        if first is not None and second is not None:
            step = self._increment.process(
                OdometryIncrementInputs(
                    first=first.matrix,
                    second=second.matrix,
                    mount=self._mount,
                    first_covariance=first.covariance,
                    second_covariance=second.covariance,
                )
            )
            return UncertainTransform(step.increment, step.covariance + np.diag(sigma**2))
        interval_s = (second_ns - first_ns) * 1e-9
        drift = np.repeat([cfg.drift_m_s, np.radians(cfg.drift_deg_s)], 3) * abs(interval_s)
        return UncertainTransform(se3.exp_se3(self._velocity * interval_s), np.diag(sigma**2 + drift**2))

    def lidar_poses(
        self, t0_ns: int, t1_ns: int, T_base_lidar: se3.FloatArray
    ) -> tuple[NDArray[np.int64], se3.FloatArray]:
        """Return times (k,) and ``T_end_lidar`` (k, 4, 4) during a sweep, relative to the base at its end."""
        stamps = self._odometry.stamps_ns
        is_covered = bool(stamps) and stamps[0] <= t0_ns and stamps[-1] >= t1_ns
        within_sweep = [t for t in stamps if t0_ns < t < t1_ns] if is_covered else []
        times = sorted({t0_ns, *within_sweep, t1_ns})
        poses = [se3.inverse(self.between(t, t1_ns).matrix) @ T_base_lidar for t in times]
        return np.array(times, dtype=np.int64), np.array(poses)

    @property
    def _velocity(self) -> se3.FloatArray:
        """Twist (6,) per second between the last two poses; zero without two poses."""
        if len(self._poses) < 2:
            return np.zeros(6)
        (t0, first), (t1, second) = self._poses
        return se3.log_se3(se3.inverse(first) @ second) / max((t1 - t0) * 1e-9, 1e-6)

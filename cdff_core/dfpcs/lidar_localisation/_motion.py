# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How the robot moved between two times: by odometry where there is some, else as it did before."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cdff_common.geometry import PoseTrack, UncertainTransform, se3
from cdff_common.types import PoseTrajectory
from cdff_core.dfns.odometry_increment._interface import OdometryIncrementInputs

if TYPE_CHECKING:
    from cdff_common.interfaces.dfn import Dfn
    from cdff_common.types import TransformWithCovariance
    from cdff_core.dfpcs.lidar_localisation._configuration import LidarLocalisationConfig

_KEEP_NS = 60_000_000_000


class Motion:
    """The odometry of the last minute, and the last two poses.

    Parameters
    ----------
    increment : Dfn
        OdometryIncrement.
    config : LidarLocalisationConfig
    """

    def __init__(self, increment: Dfn[Any, Any, Any], config: LidarLocalisationConfig) -> None:
        self._increment, self._config = increment, config
        self._track = PoseTrack()
        self._frames = ("", "")
        self._mount = np.eye(4)
        self._poses: list[tuple[int, se3.FloatArray]] = []

    def insert(self, stamp_ns: int, odometry: TransformWithCovariance, T_base_child: se3.FloatArray) -> None:
        """Take an odometry whose child sits at ``T_base_child``; one of other frames begins anew."""
        frames = (odometry.parent_frame, odometry.child_frame)
        if frames != self._frames:
            self._track, self._frames = PoseTrack(), frames
        self._mount = T_base_child
        self._track.insert(stamp_ns, odometry.transform)
        self._track.forget_before(stamp_ns - _KEEP_NS)

    def localised(self, stamp_ns: int, T_map_base: se3.FloatArray) -> None:
        """Take a pose: without odometry the robot goes on as it went between the last two."""
        self._poses = [*self._poses[-1:], (stamp_ns, T_map_base)]

    def forget_poses(self) -> None:
        """Forget how it went: the next pose is no continuation of the last."""
        self._poses = []

    @property
    def last_ns(self) -> int | None:
        """Stamp of the newest odometry."""
        return self._track.stamps_ns[-1] if self._track.stamps_ns else None

    def between(self, first_ns: int, second_ns: int) -> UncertainTransform:
        """``T_base1_base2`` with its covariance."""
        stamps = self._track.stamps_ns
        cfg = self._config
        spread = np.repeat([cfg.step_sigma_m, np.radians(cfg.step_sigma_deg)], 3)
        if stamps and stamps[0] <= first_ns and stamps[-1] >= second_ns:
            first, second = (self._track.at(t) for t in (first_ns, second_ns))
            step = self._increment.process(
                OdometryIncrementInputs(first.matrix, second.matrix, self._mount, first.covariance, second.covariance)
            )
            return UncertainTransform(step.increment, step.covariance + np.diag(spread**2))
        dt_s = (second_ns - first_ns) * 1e-9
        drift = np.repeat([cfg.drift_m_s, np.radians(cfg.drift_deg_s)], 3) * abs(dt_s)
        return UncertainTransform(se3.exp_se3(self._velocity * dt_s), np.diag(spread**2 + drift**2))

    def sweep(self, t0_ns: int, t1_ns: int, T_base_lidar: se3.FloatArray) -> PoseTrajectory:
        """``T_end_lidar(t)``: the lidar during a sweep, seen from the base at its end."""
        stamps = self._track.stamps_ns
        inner = (
            [t for t in stamps if t0_ns < t < t1_ns] if stamps and stamps[0] <= t0_ns and stamps[-1] >= t1_ns else []
        )
        times = sorted({t0_ns, *inner, t1_ns})
        poses = [se3.inverse(self.between(t, t1_ns).matrix) @ T_base_lidar for t in times]
        return PoseTrajectory.from_arrays(times, np.array(poses), None, parent="end", child="lidar")

    @property
    def _velocity(self) -> se3.FloatArray:
        """Twist (6,) a second between the last two poses; nothing where there are not two."""
        if len(self._poses) < 2:
            return np.zeros(6)
        (t0, first), (t1, second) = self._poses
        return se3.log_se3(se3.inverse(first) @ second) / max((t1 - t0) * 1e-9, 1e-6)

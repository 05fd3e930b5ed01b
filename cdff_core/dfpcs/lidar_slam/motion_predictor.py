# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the lidar's motion to the end of a sweep."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.clock import NS_PER_S
from cdff_common.geometry import OdometryBuffer, UncertainTransform, se3
from cdff_common.types import LidarScan
from cdff_core.dfpcs.lidar_slam.configuration import MotionPrediction
from cdff_core.dfpcs.lidar_slam.motion_uncertainty import MotionUncertainty

Float = NDArray[np.float64]

_HISTORY_NS = 60 * NS_PER_S
#: Interval since the previous sweep that is assumed for the first sweep.
_FIRST_INTERVAL_S = 0.1
#: Constant part of the standard deviations of a motion that the odometry measures: translation, rotation
#: about x and y, rotation about z.
_ODOMETRY_SIGMA_M, _ODOMETRY_TILT_SIGMA_RAD, _ODOMETRY_YAW_SIGMA_RAD = 0.02, 0.05, 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Predicted motion to the end of a sweep."""

    T_previous_current: Float  # (4, 4)
    covariance: Float  # (6, 6) of this motion, in the lidar's axes
    T_end_start: Float  # (4, 4), motion during the sweep
    interval_s: float  # since the end of the previous sweep
    sweep_fraction: float | None  # duration of the sweep over ``interval_s``; None without a previous sweep
    used_odometry: bool


class MotionPredictor:
    """Predicts the motion from the odometry of the base if available, otherwise at constant velocity.

    Without ``T_base_lidar`` (unknown mount) the odometry is used as if its frame were that of the lidar.
    """

    def __init__(self, config: MotionPrediction, T_base_lidar: Float | None) -> None:
        self._config = config
        self._T_base_lidar = np.eye(4) if T_base_lidar is None else T_base_lidar
        self.is_mount_known = T_base_lidar is not None
        self._odometry = OdometryBuffer(_HISTORY_NS, int(config.odometry_max_age_s * NS_PER_S))
        self._last_odometry: Float | None = None  # ``T_odom_lidar`` at the last increment

    def insert(self, stamp_ns: int, T_odom_base: UncertainTransform) -> None:
        """Add a pose of the odometry."""
        self._odometry.insert(stamp_ns, T_odom_base)

    def increment(self, stamp_ns: int) -> Float | None:
        """Return ``T_previous_current`` (4, 4) of the lidar since the previous call; None without a pose.

        The increment starts at the pose with which the previous one ended, so that errors of extrapolation
        do not accumulate.
        """
        pose = self._odometry.pose(stamp_ns)
        previous, self._last_odometry = (
            self._last_odometry,
            None if pose is None else pose.matrix @ self._T_base_lidar,
        )
        return (
            None
            if previous is None or self._last_odometry is None
            else se3.inverse(previous) @ self._last_odometry
        )

    def velocity(self, stamp_ns: int) -> Float | None:
        """Return the lidar's twist (6,) per second in its axes from the odometry; None without odometry."""
        window_ns = NS_PER_S // 5
        motion = self._odometry.motion(stamp_ns - window_ns, stamp_ns)
        if motion is None:
            return None
        T_lidar = se3.inverse(self._T_base_lidar) @ motion @ self._T_base_lidar
        return se3.vector_from_transform(T_lidar) * (NS_PER_S / window_ns)

    def predict(
        self, scan: LidarScan, previous_ns: int | None, velocity: Float, uncertainty: MotionUncertainty
    ) -> Prediction:
        """Predict the motion since the end of the previous sweep and during this one.

        ``velocity`` (6,) of the lidar is in its axes, metres and radians per second; ``uncertainty`` is the
        uncertainty of the motion at this velocity. Odometry, if available, replaces both.
        """
        increment = self.increment(scan.t1_ns)
        duration_ns = scan.t1_ns - scan.t0_ns
        interval_s, sweep_fraction = _FIRST_INTERVAL_S, None
        if previous_ns is not None:
            interval_s = max((scan.t1_ns - previous_ns) / NS_PER_S, 1e-3)
            sweep_fraction = min(1.0, duration_ns / NS_PER_S / interval_s)
        covariance = uncertainty.covariance(interval_s)
        if increment is not None:
            # Without a previous sweep, predict() may run twice for one sweep (``_restart_on_map``): the
            # second increment is zero, and does not measure the velocity.
            if previous_ns is not None:
                velocity = se3.vector_from_transform(increment) / interval_s
            path_m = float(np.linalg.norm(increment[:3, 3]))
            sigma_m = np.hypot(_ODOMETRY_SIGMA_M, self._config.odometry_sigma_ratio * path_m)
            covariance = np.diag(
                np.square([sigma_m] * 3 + [_ODOMETRY_TILT_SIGMA_RAD] * 2 + [_ODOMETRY_YAW_SIGMA_RAD])
            )
        motion = se3.transform_from_vector
        return Prediction(
            T_previous_current=motion(velocity * interval_s) if increment is None else increment,
            covariance=covariance,
            T_end_start=se3.inverse(motion(velocity * duration_ns / NS_PER_S)),
            interval_s=interval_s,
            sweep_fraction=sweep_fraction,
            used_odometry=increment is not None,
        )

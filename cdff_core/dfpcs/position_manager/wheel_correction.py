# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correction by wheel increments, with slip and the noise of both wheel poses."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.kalman_correction.interface import KalmanCorrectionInputs
from cdff_core.dfns.odometry_increment.interface import OdometryIncrementOutputs
from cdff_core.dfpcs.position_manager.estimate import OFFSETS, SLIP, Estimate
from cdff_core.dfpcs.position_manager.mount_errors import offset_displacement

#: Name of the clone at the end of an increment while it is processed.
_END = "odometry:end"
#: Time constant of the wheels' average speed, seconds.
_SPEED_TIME_S = 1.0
#: Components of a wheel increment that are used: translation and heading; without IMU also roll and pitch,
#: whose changes are assumed to be within the covariance of the increment.
_ROWS, _ROWS_WITHOUT_IMU = np.array([0, 1, 2, 5]), np.arange(6)
#: Standard deviation of the heading from the wheels after one metre, rad, if a gyro measures the heading
#: too. Unequal wheels or ground cause a constant curvature, which does not average out and looks like a bias
#: of the gyro: this value keeps the bias uncertain by 0.01 rad/m after 100 m.
_YAW_WITH_GYRO_RAD_SQRT_M = 0.1
#: The offsets of stamps are not corrected by increments: velocities are too noisy as their derivative, and
#: would bias them. ``TimeOffset`` estimates them from rotations.
_OFFSETS = np.array([*OFFSETS.values()])
#: Variance added to that of an increment between the clones, so that the innovation covariance is regular.
_LEAST_VARIANCE = 1e-10


def kalman_corrected(
    estimate: Estimate,
    dfn: Dfn[Any, Any, Any],
    residual: FloatArray,
    H: FloatArray,
    noise: FloatArray,
    *,
    is_relative: bool = True,
) -> Estimate:
    """Return the estimate after a Kalman correction; raises RefusedError if the innovation is too large."""
    out = dfn.process(
        KalmanCorrectionInputs(
            residual=residual, jacobian=H, noise=noise, covariance=estimate.covariance, considered=_OFFSETS
        )
    )
    corrected = estimate.corrected(out.correction, out.covariance, out.gain @ H, is_relative=is_relative)
    return replace(corrected, innovation_ratio=out.innovation / len(residual))


def corrected_by_wheels(
    estimate: Estimate,
    dfn: Dfn[Any, Any, Any],
    measured: UncertainTransform,
    step: OdometryIncrementOutputs,
    scale: float,
    *,
    has_imu: bool,
) -> Estimate:
    """Return the estimate corrected with a wheel increment; raises RefusedError if the increment contradicts
    it.

    Both ends are clones that contain the noise of the two wheel poses: an error that makes an increment too
    long makes the next one too short. Slip is relative to the distance at the wheels' average speed, because
    slip relative to the length of the increment would follow its noise.
    """
    interval_s = (estimate.stamp_ns - estimate.clones["odometry"].stamp_ns) * 1e-9
    speed, distance_m = _average_motion(estimate.wheel_speed_m_s, float(step.increment[0, 3]), interval_s)
    ended = estimate.with_clone(_END, measured, scale * step.pose_covariance)
    expected, H = ended.relative_motion("odometry", _END)
    residual = pose_error(step.increment, expected)
    residual[:3] -= estimate.slip * distance_m
    H[:3, SLIP] = distance_m * np.eye(3)
    residual[:3] -= offset_displacement(estimate, "odometry", H)
    rows = _ROWS if has_imu else _ROWS_WITHOUT_IMU
    noise = scale * step.covariance[np.ix_(rows, rows)] + _LEAST_VARIANCE * np.eye(len(rows))
    if has_imu:
        noise[3, 3] += scale * _YAW_WITH_GYRO_RAD_SQRT_M**2 * step.distance_m
    corrected = kalman_corrected(ended, dfn, residual[rows], H[rows], noise)
    return replace(corrected.with_renamed_clone(_END, "odometry"), wheel_speed_m_s=speed)


def _average_motion(speed_m_s: float, distance_m: float, interval_s: float) -> tuple[float, float]:
    """Return the exponentially averaged speed after an increment, and its integral over the increment.

    In the integral, alternating errors of successive increments cancel. Over an interval much longer than the
    time constant it is the measured distance.
    """
    if interval_s <= 0.0:
        return speed_m_s, 0.0
    fraction = -math.expm1(-interval_s / _SPEED_TIME_S)
    change = distance_m / interval_s - speed_m_s
    return speed_m_s + fraction * change, distance_m - fraction * _SPEED_TIME_S * change

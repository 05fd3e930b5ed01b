# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the mounts of IMU, camera and lidar: constant rotations in the state, and uncertain positions.

The sensor at position l of the base is rotated by a small ``d`` and shifted by ``s`` (base axes) from its
stated mount M. An increment of the base ``M S M^-1`` with rotation R and translation t then changes by
``d x t + (I - R) (s - d x l)`` and ``(I - R) d``. The attitude by a rotated IMU is wrong by ``-R d``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_core.dfpcs.position_manager.configuration import MountParameters
from cdff_core.dfpcs.position_manager.estimate import MOUNTS, OFFSETS, ROTATION, VELOCITY, Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames

_IMU = MOUNTS["imu"]
#: Bound of the squared Mahalanobis norm of an estimated rotation by its stated covariance: the quantile 0.999
#: of chi-square with 3 degrees of freedom.
_MAX_SQUARED_NORM = 16.27


class MountErrors:
    """Covariances of the mounts, stated in the frame tree or else by parameters."""

    def __init__(self, parameters: MountParameters, frames: RobotFrames) -> None:
        self._frames = frames
        self._imu_variance = np.radians(parameters.imu_sigma_deg) ** 2
        sigmas = [parameters.sensor_sigma_m] * 3 + [np.radians(parameters.sensor_sigma_deg)] * 3
        self._sensor = np.diag(np.square(sigmas))

    def covariance(self, frame: str, stamp_ns: int) -> FloatArray:
        """Return the covariance (6, 6) of the mount of a sensor in base axes; zero for the base itself."""
        if frame == self._frames.base:
            return np.zeros((6, 6))
        stated_covariance = self._frames.mount_covariance(frame, stamp_ns)
        return self._sensor if stated_covariance is None else stated_covariance

    def imu_covariance(self, stamp_ns: int) -> FloatArray:
        """Return the covariance (3, 3) of the rotation of the IMU in base axes."""
        stated_covariance = self._frames.mount_covariance(self._frames.imu, stamp_ns)
        return self._imu_variance * np.eye(3) if stated_covariance is None else stated_covariance[3:, 3:]

    def attached(self, estimate: Estimate, source: str, frame: str) -> Estimate:
        """Return the estimate with the covariance of the mount of a source, if this is its first pose."""
        rows = MOUNTS.get(source)
        if rows is None or estimate.covariance[rows, rows].any():
            return estimate
        P = estimate.covariance.copy()
        P[rows, rows] = self.covariance(frame, estimate.stamp_ns)[3:, 3:]
        return replace(estimate, covariance=P)

    def deviations(self, estimate: Estimate, sensor_frames: Mapping[str, str]) -> tuple[str, ...]:
        """Return a reason for each mount whose estimated rotation its stated covariance does not allow.

        ``sensor_frames`` maps sources to frames. The estimate of a mount scatters by at most its stated
        covariance, because it shrinks towards the stated mount.
        """
        reasons = []
        for source, frame in sensor_frames.items():
            error, t_ns = estimate.mount_error(source), estimate.stamp_ns
            covariance = (
                self.imu_covariance(t_ns) if source == "imu" else self.covariance(frame, t_ns)[3:, 3:]
            )
            if covariance.any() and error @ np.linalg.pinv(covariance) @ error > _MAX_SQUARED_NORM:
                reasons.append(f"mount_error:{source}_{np.degrees(np.linalg.norm(error)):.2f}_deg")
        return tuple(reasons)


def corrected_mount(estimate: Estimate, source: str, mount: FloatArray) -> FloatArray:
    """Return the mount ``T_base_sensor`` (4, 4) of a source with its estimated rotation error."""
    T = mount.copy()
    T[:3, :3] = se3.exp_so3(estimate.mount_error(source)) @ mount[:3, :3]
    return T


def increment_jacobian(step: FloatArray, lever_m: FloatArray) -> FloatArray:
    """Return the Jacobian (6, 6) of an increment (4, 4) of the base with respect to ``[s d]`` of the mount.

    ``lever_m`` (3,) is the position of the sensor in the base.
    """
    J = np.zeros((6, 6))
    J[:3, :3] = J[3:, 3:] = np.eye(3) - step[:3, :3]
    J[:3, 3:] = J[:3, :3] @ se3.skew(lever_m) - se3.skew(step[:3, 3])
    return J


def with_imu_mount_error(estimate: Estimate, predicted: Estimate, gravity_m_s2: float | None) -> Estimate:
    """Return an IMU prediction whose covariances include the error of the mount of the IMU.

    The rotation error changes by ``-(R_end - R_start) d``, the velocity error by the rotated specific force.
    """
    G = np.zeros((15, 3))
    R_start, R_end = estimate.pose[:3, :3], predicted.pose[:3, :3]
    G[ROTATION] = R_start - R_end
    if gravity_m_s2 is not None:
        interval_s = (predicted.stamp_ns - estimate.stamp_ns) * 1e-9
        force_integral = predicted.velocity - estimate.velocity + [0.0, 0.0, gravity_m_s2 * interval_s]
        G[VELOCITY] = -se3.skew(force_integral) @ R_start
        G[:3] = 0.5 * interval_s * G[VELOCITY]
    P, cross = predicted.covariance.copy(), predicted.cross_covariance.copy()
    P[:15] += G @ P[_IMU]
    P[:, :15] += P[:, _IMU] @ G.T
    cross[:15] += G @ cross[_IMU]
    return replace(predicted, covariance=P, cross_covariance=cross)


def with_stamp_offset(estimate: Estimate, source: str, sigma_s: float) -> Estimate:
    """Return the estimate with an unknown offset of the stamps of an odometry after a new correction."""
    row = OFFSETS[source]
    P, cross, calibration = (
        estimate.covariance.copy(),
        estimate.cross_covariance.copy(),
        estimate.calibration.copy(),
    )
    P[row] = P[:, row] = cross[row] = calibration[row - 18] = 0.0
    P[row, row] = sigma_s**2
    return replace(estimate, covariance=P, cross_covariance=cross, calibration=calibration)


def offset_displacement(estimate: Estimate, source: str, H: FloatArray) -> FloatArray:
    """Return the change (3,) of an increment since a clone due to the offset of its stamps, and write its
    column of H.

    Both poses are measured later by the offset, during which the robot moves by its velocities there.
    """
    clone = estimate.clones[source]
    change_m_s = clone.pose[:3, :3].T @ (estimate.velocity - clone.velocity)
    H[:3, OFFSETS[source]] = change_m_s
    return change_m_s * estimate.stamp_offset_s(source)

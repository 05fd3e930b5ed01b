# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""First estimate: position and heading from anchor and wheels, roll and pitch from gravity."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import Sample
from cdff_core.dfns.gravity_levelling.interface import GravityLevellingInputs
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import FORCE, MOUNTS, ROTATION, TIMELINE_ERRORS, Estimate
from cdff_core.dfpcs.position_manager.frame_tree import RobotFrames
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.motion_prediction import UNKNOWN_SPEED_SIGMA_M_S
from cdff_core.dfpcs.position_manager.mount_errors import MountErrors

#: Duration of the IMU readings from which the start pose is levelled, and longest wait for them,
#: nanoseconds.
_LEVELLING_NS, _MAX_WAIT_NS = 500_000_000, 1_000_000_000
#: Standard deviations after levelling: speed in motion and at rest, gyro bias at rest.
_MOVING_SPEED_M_S, _REST_SPEED_M_S, _REST_BIAS_RAD_S = 0.5, 0.02, 2.2e-4


@dataclass(frozen=True, slots=True, eq=False)
class InitialState:
    """Start of the timeline."""

    estimate: Estimate
    T_odom_base: UncertainTransform
    gravity_m_s2: float | None  # strength of gravity; None without IMU
    reasons: tuple[str, ...]  # deficiencies of the start pose


class Initialiser:
    """Buffers samples until the start pose can be levelled."""

    def __init__(
        self,
        config: PositionManagerConfig,
        levelling: Dfn[Any, Any, Any],
        imu: ImuBuffer,
        frames: RobotFrames,
    ) -> None:
        self._config, self._levelling, self._imu, self._frames = config, levelling, imu, frames
        self._mounts = MountErrors(config.mounts, frames)
        self._samples: list[Sample] = []

    def add(self, sample: Sample) -> bool:
        """Buffer a sample; return True if the start pose can be levelled or the waiting time is over."""
        self._samples.append(sample)
        waited_ns = sample.stamp_ns - self._samples[0].stamp_ns
        return self._imu.span_ns >= _LEVELLING_NS or waited_ns >= _MAX_WAIT_NS

    @property
    def has_samples(self) -> bool:
        """True if samples are waiting."""
        return bool(self._samples)

    def finish(self) -> tuple[InitialState, list[Sample]]:
        """Return the state at the first pose, and the buffered samples that are not IMU readings."""
        samples, self._samples = self._samples, []
        poses = [s for s in samples if s.port != "imu" and s.value is not None] or samples[:1]
        wheels = next(
            (s.value.transform for s in samples if s.port == "odometry" and s.value is not None),
            UncertainTransform.identity(),
        )
        state = self._initial_state(min(s.stamp_ns for s in poses), wheels)
        return state, [s for s in samples if s.port != "imu"]

    def _initial_state(self, stamp_ns: int, wheels: UncertainTransform) -> InitialState:
        """Return the state at the start: levelled by the IMU if possible, with the reasons of its limits."""
        start = self._config.start
        forces, rates = self._imu.all()
        reasons: tuple[str, ...] = ()
        tilt, sigma, gravity, at_rest = np.eye(3), start.tilt_sigma_rad, None, False
        biases = np.zeros(6)
        try:
            level = self._levelling.process(GravityLevellingInputs(specific_force=forces, rates_rad_s=rates))
        except RefusedError as error:
            reasons = ("not_levelled", *error.reasons)
        else:
            tilt, at_rest = level.rotation, level.at_rest
            gravity = float(np.linalg.norm(forces.mean(axis=0)))
            sigma = float(np.sqrt(level.covariance[0, 0]))
            biases[:3] = level.gyro_bias_rad_s
            reasons = () if at_rest else ("levelled_in_motion",)
        T_odom_base = _level_pose(wheels, tilt, sigma)
        bias_sigma = _REST_BIAS_RAD_S if at_rest else start.gyro_bias_sigma_rad_s
        sigmas = np.array(
            [bias_sigma] * 3 + [start.acc_bias_sigma_m_s2] * 3 + [*self._config.wheels.slip_sigma]
        )
        in_motion = UNKNOWN_SPEED_SIGMA_M_S if gravity is None else _MOVING_SPEED_M_S
        speed_sigma = _REST_SPEED_M_S if at_rest else in_motion
        T_site_base = self._frames.fixed("site", self._frames.odom) @ T_odom_base
        estimate = Estimate.at_start(stamp_ns, T_site_base, speed_sigma, biases, sigmas)
        if gravity is not None and at_rest:
            estimate = _with_tilt_from_bias(estimate, gravity, start.acc_bias_sigma_m_s2)
        if gravity is not None:
            C = self._mounts.imu_covariance(stamp_ns)
            estimate = _with_tilt_from_mount(estimate, C)
            response = _rotation_by_mount(T_odom_base.matrix[:3, :3])
            covariance = np.array(T_odom_base.covariance)
            covariance[3:, 3:] += response @ C @ response.T
            T_odom_base = UncertainTransform(T_odom_base.matrix, covariance)
        return InitialState(estimate, T_odom_base, gravity, reasons)


def _level_pose(wheels: UncertainTransform, tilt: FloatArray, sigma_rad: float) -> UncertainTransform:
    """Return the pose of the wheel odometry with roll and pitch replaced by the levelled tilt (3, 3)."""
    forward = wheels.matrix[:3, 0]
    R = se3.exp_so3([0.0, 0.0, float(np.arctan2(forward[1], forward[0]))]) @ tilt
    covariance = np.zeros((6, 6)) if wheels.covariance is None else wheels.covariance.copy()
    covariance[3:5, :] = covariance[:, 3:5] = 0.0
    response = _rotation_by_tilt(R)
    covariance[3:, 3:] += sigma_rad**2 * response @ response.T
    return UncertainTransform(se3.transform(R, wheels.matrix[:3, 3]), covariance)


def _rotation_by_tilt(R_site_base: FloatArray) -> FloatArray:
    """Return the Jacobian (3, 3) of the rotation error with respect to a tilt error (x, y, unused) at fixed
    heading.

    The heading is that of the x axis ``a`` of the base. If ``a`` is inclined, a tilt error ``w`` about its
    horizontal part also changes its heading; a rotation about z compensates this:
    ``w_z = a_z (w_x a_x + w_y a_y) / (a_x^2 + a_y^2)``.
    """
    a = R_site_base[:, 0]
    response = np.diag([1.0, 1.0, 0.0])
    response[2, :2] = a[2] * a[:2] / float(a[:2] @ a[:2])
    return response


def _with_tilt_from_bias(estimate: Estimate, gravity_m_s2: float, sigma_m_s2: float) -> Estimate:
    """Return the estimate with the tilt error correlated with the accelerometer bias that caused it.

    The measured gravity is ``R^T g + b``: a bias b tilts the base by ``(-b_y, b_x, 0) / g`` in level axes,
    and rotates it about z at a fixed heading. The bias along gravity is part of the measured strength of
    gravity.
    """
    R = estimate.pose[:3, :3]
    level = np.diag([sigma_m_s2**2, sigma_m_s2**2, (0.1 * sigma_m_s2) ** 2])
    tilt_by_bias = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    response = _rotation_by_tilt(R) @ tilt_by_bias / gravity_m_s2
    P = estimate.covariance.copy()
    P[FORCE, FORCE] = R.T @ level @ R
    P[ROTATION, FORCE] = response @ level @ R
    P[FORCE, ROTATION] = P[ROTATION, FORCE].T
    return replace(estimate, covariance=P, cross_covariance=P[:, TIMELINE_ERRORS].copy())


def _rotation_by_mount(R_site_base: FloatArray) -> FloatArray:
    """Return the Jacobian (3, 3) of the rotation error of a levelled pose with respect to that of the IMU's
    mount.
    """
    return -_rotation_by_tilt(R_site_base) @ R_site_base


def _with_tilt_from_mount(estimate: Estimate, mount_covariance: FloatArray) -> Estimate:
    """Return the estimate with the rotation error of the IMU's mount, which tilts the levelled pose."""
    response, rows = _rotation_by_mount(estimate.pose[:3, :3]), MOUNTS["imu"]
    P = estimate.covariance.copy()
    P[rows, rows] = mount_covariance
    P[ROTATION, rows] = response @ mount_covariance
    P[rows, ROTATION] = P[ROTATION, rows].T
    P[ROTATION, ROTATION] += response @ mount_covariance @ response.T
    return replace(estimate, covariance=P, cross_covariance=P[:, TIMELINE_ERRORS].copy())

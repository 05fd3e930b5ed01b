# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Simulated proprioception of a rover: IMU readings, and odometry of slipping wheels."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import compose_covariance
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.faults import imu, wheels
from cdff_dev.simulate.faults.imu import ImuFaults
from cdff_dev.simulate.faults.wheels import WheelFaults
from cdff_dev.simulate.rover_motion import Motion
from cdff_dev.simulate.scenario import Imu, Wheels


@dataclass(frozen=True, slots=True, eq=False)
class ImuTrack:
    """Readings ``(n, 3)`` in IMU axes: specific force in m/s^2 and angular rate in rad/s."""

    acc_m_s2: FloatArray
    gyro_rad_s: FloatArray


def faulty_imu_readings(
    track: ImuTrack, model: ImuFaults, motion: Motion, t_s: FloatArray, rng: np.random.Generator
) -> ImuTrack:
    """Return the readings at times ``(n,)`` with the faults of the IMU."""
    moving = (t_s, np.abs(motion.distance(t_s, 1)), motion.distance(t_s))
    return ImuTrack(*imu.disturbed(model, track.acc_m_s2, track.gyro_rad_s, moving, rng))


def imu_readings(
    model: Imu, motion: Motion, t_s: FloatArray, gravity_m_s2: float, rng: np.random.Generator
) -> ImuTrack:
    """Return the readings at times ``(n,)``, which must be spaced at the rate of the model.

    The specific force is ``R^T (a_imu - g)``, with the tangential and centripetal accelerations of the lever
    arm. White noise of density sigma has a standard deviation of ``sigma sqrt(rate)`` per sample (IEEE Std
    952).
    """
    T_base_imu = model.mount.matrix()
    R_base_imu, lever = T_base_imu[:3, :3], T_base_imu[:3, 3]
    R_site_base = motion.poses(t_s)[:, :3, :3]
    rate, rate_dot = motion.body_rates(t_s), motion.body_accelerations(t_s)
    lever_acceleration = np.cross(rate_dot, lever) + np.cross(rate, np.cross(rate, lever))
    up = np.array([0.0, 0.0, gravity_m_s2])
    force_base = np.einsum("nji,nj->ni", R_site_base, motion.acceleration(t_s) + up) + lever_acceleration
    return with_sensor_errors(model, force_base @ R_base_imu, rate @ R_base_imu, rng)


def with_sensor_errors(
    model: Imu, acc_m_s2: FloatArray, gyro_rad_s: FloatArray, rng: np.random.Generator
) -> ImuTrack:
    """Return the readings of true specific forces and rates ``(n, 3)``, IMU axes, rate of the model."""
    n, root_hz, dt = len(acc_m_s2), math.sqrt(model.rate_hz), 1.0 / model.rate_hz

    def errors(bias_sigma: float, noise: float, walk: float) -> FloatArray:
        bias = bias_sigma * rng.standard_normal(3)
        drift = np.cumsum(walk * math.sqrt(dt) * rng.standard_normal((n, 3)), axis=0)
        return bias + drift + noise * root_hz * rng.standard_normal((n, 3))

    gyro = gyro_rad_s + errors(
        model.gyro_bias_sigma_rad_s, model.gyro_noise_rad_s_sqrt_hz, model.gyro_walk_rad_s2_sqrt_hz
    )
    acc = acc_m_s2 + errors(
        model.acc_bias_sigma_m_s2, model.acc_noise_m_s2_sqrt_hz, model.acc_walk_m_s3_sqrt_hz
    )
    return ImuTrack(acc, gyro)


@dataclass(frozen=True, slots=True, eq=False)
class WheelTrack:
    """Planar dead reckoning: poses ``T_odom_base`` ``(n, 4, 4)`` and reported covariances ``(n, 6, 6)``."""

    poses: FloatArray
    covariances: FloatArray


def wheel_odometry(
    model: Wheels,
    motion: Motion,
    t_s: FloatArray,
    rng: np.random.Generator,
    faults: tuple[WheelFaults, np.random.Generator] | None = None,
) -> WheelTrack:
    """Return the odometry at times ``(n,)``.

    ``faults`` are the faults of the wheels and the generator of their random numbers.

    Slip, the relative difference between wheel rotation and motion, grows uphill and varies as an
    Ornstein-Uhlenbeck process. Sideways slip on cross slopes is not measured. The yaw of skid steering has a
    gain error and noise. The odometry is planar: it starts at the identity and has no tilt, for which the
    covariance accounts.
    """
    poses = motion.poses(t_s if faults is None else np.maximum(t_s - faults[0].delay_s, 0.0))
    n = len(t_s)
    steps = se3.inverse(poses[:-1]) @ poses[1:]
    forward = steps[:, 0, 3]
    yaw = np.arctan2(steps[:, 1, 0], steps[:, 0, 0])
    uphill = poses[:-1, 2, 0]  # sine of the slope along the x axis of the base
    cross_slope = poses[:-1, 2, 1]
    slip = model.slip_mean + model.slip_per_slope * np.maximum(uphill, -0.05) + _slip_noise(model, t_s, rng)
    slip = np.clip(slip, -0.05, 0.6)
    distance = np.abs(forward)
    dx = forward / (1.0 - slip)
    # The rover slides down the cross slope; the wheels do not measure this motion, so it is removed.
    dy = steps[:, 1, 3] + model.side_slip_per_slope * cross_slope * distance
    gain = 1.0 + model.yaw_gain_sigma * rng.standard_normal()
    dyaw = gain * yaw + model.yaw_noise_rad_sqrt_m * np.sqrt(distance) * rng.standard_normal(n - 1)
    if faults is not None:
        dx, dy, dyaw = wheels.disturbed(faults[0], dx, dy, dyaw, faults[1])
    return _accumulate(model, dx, dy, dyaw)


def _slip_noise(model: Wheels, t_s: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return an Ornstein-Uhlenbeck process ``(n - 1,)`` over the intervals between times ``(n,)``."""
    correlation = np.exp(-np.diff(t_s) / model.slip_correlation_s)
    normals = rng.standard_normal(len(correlation))
    process = np.empty(len(correlation))
    value = 0.0
    for i, (c, normal) in enumerate(zip(correlation, normals, strict=True)):
        value = c * value + model.slip_sigma * math.sqrt(1.0 - c * c) * normal
        process[i] = value
    return process


def _accumulate(model: Wheels, dx: FloatArray, dy: FloatArray, dyaw: FloatArray) -> WheelTrack:
    """Compose increments ``(n - 1,)`` in base axes to poses with covariances."""
    n = len(dx) + 1
    poses = np.tile(np.eye(4), (n, 1, 1))
    covariances = np.zeros((n, 6, 6))
    distance_m = 0.0
    for i in range(1, n):
        step = se3.transform(se3.exp_so3([0, 0, dyaw[i - 1]]), [dx[i - 1], dy[i - 1], 0.0])
        poses[i] = poses[i - 1] @ step
        length = abs(float(dx[i - 1]))
        # The scale error is the same for the whole path, so that its variance grows with the square of the
        # path length: the variance of an increment is proportional to the difference of the squares.
        square = (distance_m + length) ** 2 - distance_m**2
        distance_m += length
        increment = np.diag(
            [
                model.reported_distance_sigma**2 * square,
                model.reported_side_sigma**2 * square,
                model.reported_tilt_sigma_rad**2 * square,
                0.0,
                0.0,
                model.reported_yaw_sigma_rad_sqrt_m**2 * length,
            ]
        )
        covariances[i] = compose_covariance(poses[i - 1], covariances[i - 1], step, increment)
    # Tilt is not measured: its variance is constant, and zero at the first pose, which defines the frame.
    covariances[1:, 3, 3] += model.reported_tilt_sigma_rad**2
    covariances[1:, 4, 4] += model.reported_tilt_sigma_rad**2
    return WheelTrack(poses, covariances)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Navigation sensors of the servicer: star tracker, IMU and GNSS receiver."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.simulate.orbit.eclipse import EARTH_RADIUS_M
from cdff_dev.simulate.orbit.motion import OrbitMotion
from cdff_dev.simulate.orbit.sensors import Gnss, StarTracker, off_axis_rad
from cdff_dev.simulate.proprioception import ImuTrack, with_sensor_errors
from cdff_dev.simulate.scenario import Imu

_ARCSEC = math.radians(1.0 / 3600.0)


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeTrack:
    """Measured attitudes.

    Attributes
    ----------
    index : ndarray intp (k,)
        Times at which the star tracker delivers: Sun and Earth are outside its field.
    R_inertial_base : ndarray (k, 3, 3)
    covariances : ndarray (k, 3, 3)
        Of the rotation in inertial axes, rad².
    """

    index: NDArray[np.intp]
    R_inertial_base: FloatArray
    covariances: FloatArray


def star_tracker_bias(model: StarTracker, rng: np.random.Generator) -> FloatArray:
    """Return the constant error (3,) of a star tracker, axes of the tracker, rad."""
    return np.asarray(_ARCSEC * model.bias_sigma_arcsec * rng.standard_normal(3))


def star_tracker_attitudes(
    model: StarTracker, motion: OrbitMotion, t_s: FloatArray, bias: FloatArray, rng: np.random.Generator
) -> AttitudeTrack:
    """Return the attitudes measured at times (n,), with the constant error (3,) of the tracker."""
    R_base_tracker = model.mount.matrix()[:3, :3]
    R = motion.base_attitudes(t_s)
    boresights = R @ R_base_tracker[:, 0]
    valid = []
    for i, t in enumerate(t_s):
        light = motion.light(float(t))
        blinded = light.sunlit > 0.0 and off_axis_rad(boresights[i], light.to_sun) < math.radians(
            model.sun_exclusion_deg
        )
        if light.earth_m is not None:
            distance = float(np.linalg.norm(light.earth_m))
            limb = math.asin(min(EARTH_RADIUS_M / distance, 1.0)) + math.radians(model.earth_exclusion_deg)
            blinded |= off_axis_rad(boresights[i], -light.earth_m / distance) < limb
        valid.append(not blinded)
    sigma = _ARCSEC * np.array([model.roll_sigma_arcsec, model.cross_sigma_arcsec, model.cross_sigma_arcsec])
    errors = (bias + sigma * rng.standard_normal((len(t_s), 3))) @ R_base_tracker.T
    # R_inertial_base Exp(error) = Exp(R_inertial_base error) R_inertial_base.
    measured = R @ se3.exp_so3(errors)
    total = sigma**2 + (_ARCSEC * model.bias_sigma_arcsec) ** 2
    R_inertial_tracker = R @ R_base_tracker
    covariances = np.einsum("nij,j,nkj->nik", R_inertial_tracker, total, R_inertial_tracker)
    index = np.flatnonzero(valid)
    return AttitudeTrack(index, measured[index], covariances[index])


def imu_track(model: Imu, motion: OrbitMotion, t_s: FloatArray, rng: np.random.Generator) -> ImuTrack:
    """Return the readings at times (n,), spaced at the rate of the model: specific force by thrust, and rate.

    Accelerations of the lever arm between the base and the IMU are included.
    """
    T_base_imu = model.mount.matrix()
    R_base_imu, lever_m = T_base_imu[:3, :3], T_base_imu[:3, 3]
    half_step_s = 0.05
    rate = motion.base_rates(t_s)
    rate_dot = (motion.base_rates(t_s + half_step_s) - motion.base_rates(t_s - half_step_s)) / (
        2.0 * half_step_s
    )
    lever = np.cross(rate_dot, lever_m) + np.cross(rate, np.cross(rate, lever_m))
    force = np.einsum("nji,nj->ni", motion.base_attitudes(t_s), motion.specific_forces(t_s)) + lever
    return with_sensor_errors(model, force @ R_base_imu, rate @ R_base_imu, rng)


def gnss_states(
    model: Gnss, motion: OrbitMotion, t_s: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return measured positions (n, 3), m, and velocities (n, 3), m/s, inertial axes, at times (n,)."""
    slow = model.slow_sigma_m * rng.standard_normal(3)
    normals = rng.standard_normal((len(t_s), 3))
    slow_m = np.array([slow := next_slow_error(model, slow, normal) for normal in normals])
    return measured_states(model, motion, t_s, slow_m, rng)


def next_slow_error(model: Gnss, slow_m: FloatArray, normal: FloatArray) -> FloatArray:
    """Return the slow error (3,) one period after ``slow_m``, metres; ``normal`` are random numbers (3,)."""
    keep = math.exp(-1.0 / (model.rate_hz * model.slow_s))
    return np.asarray(keep * slow_m + model.slow_sigma_m * math.sqrt(1.0 - keep**2) * normal)


def measured_states(
    model: Gnss, motion: OrbitMotion, t_s: FloatArray, slow_m: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Return positions and velocities (n, 3) measured at times (n,) with slow errors (n, 3)."""
    positions_m, velocities_m_s = motion.servicer_states(t_s)
    position_noise = model.position_sigma_m * rng.standard_normal(positions_m.shape)
    velocity_noise = model.velocity_sigma_m_s * rng.standard_normal(positions_m.shape)
    return positions_m + slow_m + position_noise, velocities_m_s + velocity_noise

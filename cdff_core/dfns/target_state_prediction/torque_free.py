# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of a free rigid body with Euler's equations."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import symmetrised
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.target_state_prediction.interface import Inputs, Interface, Outputs
from cdff_core.object_models.inertia import BASIS

#: Largest rotation of a step of the integration, rad, and largest number of steps.
_STEP_RAD, _MAX_STEPS = 0.05, 2000


class TorqueFreeConfig(DfnConfig):
    """Parameters of TorqueFree."""

    acceleration_noise: float = Field(
        1e-4, ge=0, le=100, description="Noise density of the acceleration, m/s^2/sqrt(Hz)"
    )
    angular_acceleration_noise: float = Field(
        1e-5, ge=0, le=100, description="Noise density of the angular acceleration, rad/s^2/sqrt(Hz)"
    )


class TorqueFree(Interface[TorqueFreeConfig]):
    """Constant velocity and rotation without torque, with white noise of both accelerations.

    Euler's equations; e.g. Markley and Crassidis (2014), doi:10.1007/978-1-4939-0802-8,
    section 3.3. The error of the rotation is a vector in the frame: R_true = Exp(phi) R.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the state after ``duration_s``; raises InputError if it is negative."""
        dt = inputs.duration_s
        if dt < 0.0:
            raise InputError(f"duration_s={dt:g}: expected at least 0")
        R_start, c = inputs.pose[:3, :3], inputs.centre_of_mass_m
        motion = _integrate_midpoint(_Body(inputs.inertia), R_start, inputs.rate, dt)
        R = se3.normalise_rotation(motion.R)
        arm_start, arm = R_start @ c, R @ c
        pose = se3.transform(R, inputs.pose[:3, 3] + arm_start + dt * inputs.velocity - arm)
        transition = np.eye(20)
        transition[:3, 3:6] = se3.skew(arm) - se3.skew(arm_start)
        transition[:3, 6:9] = dt * np.eye(3)
        transition[:3, 12:15] = R_start - R
        for columns, rotation_jacobian, rate_jacobian in (
            (slice(9, 12), motion.rotation_jacobian[:, :3], motion.rate_jacobian[:, :3]),
            (slice(15, 20), motion.rotation_jacobian[:, 3:], motion.rate_jacobian[:, 3:]),
        ):
            transition[:3, columns] = se3.skew(arm) @ rotation_jacobian
            transition[3:6, columns] = rotation_jacobian
            transition[9:12, columns] = rate_jacobian
        scales = np.ones(2) if inputs.noise_scales is None else inputs.noise_scales
        noise = self._noise(R, arm, dt, scales)
        covariance = transition @ inputs.covariance @ transition.T + noise
        return Outputs(
            pose=pose,
            velocity=np.array(inputs.velocity, np.float64),
            rate=motion.rate,
            covariance=symmetrised(covariance),
            transition=transition,
        )

    def _noise(self, R_sensor_body: FloatArray, arm: FloatArray, dt: float, scales: FloatArray) -> FloatArray:
        """Return the covariance (20, 20) that the noise of the accelerations adds to the state."""
        noise = np.zeros((20, 20))
        linear = (scales[0] * self.config.acceleration_noise) ** 2
        angular = (scales[1] * self.config.angular_acceleration_noise) ** 2
        for (value, rate), density, axes in (((0, 6), linear, np.eye(3)), ((3, 9), angular, R_sensor_body)):
            noise[value : value + 3, value : value + 3] = density * dt**3 / 3.0 * np.eye(3)
            noise[value : value + 3, rate : rate + 3] = density * dt**2 / 2.0 * axes
            noise[rate : rate + 3, value : value + 3] = density * dt**2 / 2.0 * axes.T
            noise[rate : rate + 3, rate : rate + 3] = density * dt * np.eye(3)
        J_arm = np.eye(20)
        J_arm[:3, 3:6] = se3.skew(arm)
        return np.asarray(J_arm @ noise @ J_arm.T)


class _Body:
    """Euler's equations without torque for an inertia (3, 3), with their derivatives."""

    def __init__(self, inertia: FloatArray) -> None:
        if float(np.linalg.eigvalsh(inertia)[0]) <= 0.0:
            raise InputError(f"inertia {np.array2string(inertia)}: expected a positive definite matrix")
        self._inertia, self._inverse = inertia, np.linalg.inv(inertia)

    def acceleration(self, rate: FloatArray) -> FloatArray:
        """Return the angular acceleration (3,)."""
        return np.asarray(-self._inverse @ (se3.skew(rate) @ (self._inertia @ rate)))

    def jacobians(self, rate: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the derivatives (3, 3) and (3, 5) with respect to the rate and the errors of the inertia."""
        momentum = self._inertia @ rate
        by_rate = self._inverse @ (se3.skew(momentum) - se3.skew(rate) @ self._inertia)
        acceleration = self.acceleration(rate)
        by_inertia = -self._inverse @ (se3.skew(rate) @ (BASIS @ rate).T + (BASIS @ acceleration).T)
        return by_rate, by_inertia


@dataclass(slots=True)
class _Motion:
    """Rotation (3, 3), rate (3,), and derivatives (3, 8) with respect to the first rate and the inertia."""

    R: FloatArray
    rate: FloatArray
    rotation_jacobian: FloatArray
    rate_jacobian: FloatArray


def _integrate_midpoint(body: _Body, R_sensor_body: FloatArray, rate: FloatArray, dt: float) -> _Motion:
    """Return the motion after dt by the midpoint rule, second order in the step."""
    steps = min(max(1, math.ceil(float(np.linalg.norm(rate)) * dt / _STEP_RAD)), _MAX_STEPS)
    h = dt / steps
    motion = _Motion(R_sensor_body, np.array(rate, np.float64), np.zeros((3, 8)), np.eye(3, 8))
    direct = np.zeros((3, 8))
    for _ in range(steps):
        by_rate, direct[:, 3:] = body.jacobians(motion.rate)
        middle = motion.rate + 0.5 * h * body.acceleration(motion.rate)
        middle_by = motion.rate_jacobian + 0.5 * h * (by_rate @ motion.rate_jacobian + direct)
        motion.rotation_jacobian = (
            motion.rotation_jacobian + h * motion.R @ se3.left_jacobian_so3(h * middle) @ middle_by
        )
        by_rate, direct[:, 3:] = body.jacobians(middle)
        motion.rate_jacobian = motion.rate_jacobian + h * (by_rate @ middle_by + direct)
        motion.R = motion.R @ se3.exp_so3(h * middle)
        motion.rate = motion.rate + h * body.acceleration(middle)
    return motion

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of a free rigid body with Euler's equations."""

from __future__ import annotations

import math

import numpy as np
from pydantic import Field, field_validator

from cdff_common.arrays import FloatArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.covariance import symmetrised
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.target_state_prediction.interface import Inputs, Interface, Outputs

#: Largest rotation of a step of the integration, rad, and largest number of steps.
_STEP_RAD, _MAX_STEPS = 0.05, 2000


class TorqueFreeConfig(DfnConfig):
    """Parameters of TorqueFree."""

    inertia_ratios: tuple[float, float, float] = Field(
        (1.0, 1.0, 1.0),
        description="Principal moments of inertia along the axes of the body, up to a factor",
    )
    acceleration_noise: float = Field(
        1e-3, ge=0, le=100, description="Noise density of the acceleration, m/s^2/sqrt(Hz)"
    )
    angular_acceleration_noise: float = Field(
        1e-4, ge=0, le=100, description="Noise density of the angular acceleration, rad/s^2/sqrt(Hz)"
    )

    @field_validator("inertia_ratios")
    @classmethod
    def _is_a_body(cls, ratios: tuple[float, float, float]) -> tuple[float, float, float]:
        low, middle, high = sorted(ratios)
        if low <= 0.0 or high > low + middle:
            raise ValueError("expected moments above 0, none above the sum of the other two")
        return ratios


class TorqueFree(Interface[TorqueFreeConfig]):
    """Constant velocity and rotation without torque, with white noise of both accelerations.

    Euler's equations for principal axes; e.g. Markley and Crassidis (2014), doi:10.1007/978-1-4939-0802-8,
    section 3.3. The error of the rotation is a vector in the frame: R_true = Exp(phi) R.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the state after ``duration_s``; raises InputError if it is negative."""
        dt = inputs.duration_s
        if dt < 0.0:
            raise InputError(f"duration_s={dt:g}: expected at least 0")
        R_start, c = inputs.pose[:3, :3], inputs.centre_of_mass_m
        rate, R, rotation_by_rate, rate_by_rate = self._rotated(R_start, inputs.rate, dt)
        R = se3.normalise_rotation(R)
        arm_start, arm = R_start @ c, R @ c
        pose = se3.transform(R, inputs.pose[:3, 3] + arm_start + dt * inputs.velocity - arm)
        transition = np.eye(15)
        transition[:3, 3:6] = se3.skew(arm) - se3.skew(arm_start)
        transition[:3, 6:9] = dt * np.eye(3)
        transition[:3, 9:12] = se3.skew(arm) @ rotation_by_rate
        transition[:3, 12:] = R_start - R
        transition[3:6, 9:12] = rotation_by_rate
        transition[9:12, 9:12] = rate_by_rate
        noise = self._noise(R, arm, dt)
        covariance = transition @ inputs.covariance @ transition.T + noise
        return Outputs(
            pose=pose,
            velocity=np.array(inputs.velocity, np.float64),
            rate=rate,
            covariance=symmetrised(covariance),
        )

    def _rotated(
        self, R: FloatArray, rate: FloatArray, dt: float
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Return rate and rotation after dt, and their derivatives (3, 3) with respect to the rate."""
        moments = np.array(self.config.inertia_ratios)
        steps = min(max(1, math.ceil(float(np.linalg.norm(rate)) * dt / _STEP_RAD)), _MAX_STEPS)
        h = dt / steps
        rate, rotation_by_rate, rate_by_rate = np.array(rate, np.float64), np.zeros((3, 3)), np.eye(3)
        for _ in range(steps):
            # Midpoint rule: second order in the step.
            middle = rate + 0.5 * h * _acceleration(rate, moments)
            middle_by_rate = (np.eye(3) + 0.5 * h * _acceleration_jacobian(rate, moments)) @ rate_by_rate
            rotation_by_rate = rotation_by_rate + h * R @ se3.left_jacobian_so3(h * middle) @ middle_by_rate
            rate_by_rate = rate_by_rate + h * _acceleration_jacobian(middle, moments) @ middle_by_rate
            R = R @ se3.exp_so3(h * middle)
            rate = rate + h * _acceleration(middle, moments)
        return rate, R, rotation_by_rate, rate_by_rate

    def _noise(self, R: FloatArray, arm: FloatArray, dt: float) -> FloatArray:
        """Return the covariance (15, 15) of the integrated noise of the accelerations."""
        noise = np.zeros((15, 15))
        linear, angular = self.config.acceleration_noise**2, self.config.angular_acceleration_noise**2
        for (value, rate), density, axes in (((0, 6), linear, np.eye(3)), ((3, 9), angular, R)):
            noise[value : value + 3, value : value + 3] = density * dt**3 / 3.0 * np.eye(3)
            noise[value : value + 3, rate : rate + 3] = density * dt**2 / 2.0 * axes
            noise[rate : rate + 3, value : value + 3] = density * dt**2 / 2.0 * axes.T
            noise[rate : rate + 3, rate : rate + 3] = density * dt * np.eye(3)
        moved = np.eye(15)
        moved[:3, 3:6] = se3.skew(arm)
        return np.asarray(moved @ noise @ moved.T)


def _acceleration(rate: FloatArray, moments: FloatArray) -> FloatArray:
    """Return the angular acceleration (3,) by Euler's equations without torque."""
    return np.asarray(np.cross(moments * rate, rate) / moments)


def _acceleration_jacobian(rate: FloatArray, moments: FloatArray) -> FloatArray:
    """Return the derivative (3, 3) of the angular acceleration with respect to the rate."""
    momentum = se3.skew(moments * rate)
    return np.asarray((momentum - se3.skew(rate) @ np.diag(moments)) / moments[:, None])

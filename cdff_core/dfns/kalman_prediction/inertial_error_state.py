# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Strapdown integration with propagation of the error covariance."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.kalman_prediction._kernels import strapdown
from cdff_core.dfns.kalman_prediction.interface import Inputs, Interface, Outputs

Density = Annotated[float, Field(ge=0, le=10)]
#: Rows of the errors: position, rotation, velocity, gyroscope bias, accelerometer bias.
P, PHI, V, BG, BA = (slice(k, k + 3) for k in range(0, 15, 3))
_EYE = np.eye(3)


class InertialErrorStateConfig(DfnConfig):
    """Parameters of InertialErrorState; the defaults are for a tactical-grade sensor on a vibrating rover."""

    gyro_noise_rad_s_sqrt_hz: Density = Field(1.6e-4, description="Noise density of a rate")
    gyro_walk_rad_s2_sqrt_hz: Density = Field(6e-6, description="Random walk of the gyroscope bias")
    acc_noise_m_s2_sqrt_hz: Density = Field(
        3e-3, description="Noise density of a specific force, with vibration"
    )
    acc_walk_m_s3_sqrt_hz: Density = Field(1.6e-4, description="Random walk of the accelerometer bias")
    unseen_acceleration_m_s2_sqrt_hz: Density = Field(
        3.0, description="Noise density of the acceleration without readings"
    )
    unseen_rate_rad_s_sqrt_hz: Density = Field(
        1.0, description="Noise density of the angular rate without readings"
    )
    max_gap_s: float = Field(
        0.15, gt=0, le=10, description="Longest interval between readings that is interpolated"
    )


class InertialErrorState(Interface[InertialErrorStateConfig]):
    """Integrate readings by the trapezoidal rule, with coning to second order, and errors to first order.

    Notes
    -----
    Rotation errors are in the world frame, ``R_true = Exp(phi) R``, as for all covariances of CDFF; chapter 7
    of Solà (2017), arXiv:1711.02508, derives the transition matrix. Intervals should not exceed some tenths
    of a second, since coning of higher order is neglected.
    """

    def setup(self) -> None:
        """Compile the kernel."""
        strapdown(np.zeros(1), np.zeros((1, 6)))

    def process(self, inputs: Inputs) -> Outputs:
        """Return the propagated state; raises InputError if inputs are inconsistent."""
        start, end = (int(t) for t in inputs.interval_ns)
        if end < start or len(inputs.covariance) < 15:
            raise InputError(
                f"interval {start}..{end}, covariance {inputs.covariance.shape}: expected start <= "
                "end and 15 states"
            )
        T_s, c = (end - start) * 1e-9, self.config
        readings_in_interval = self._readings(inputs, start, end)
        R, p, v = inputs.pose[:3, :3], inputs.pose[:3, 3], inputs.velocity
        F = np.eye(15)
        F[P, V] = T_s * _EYE
        R_end, p_end, v_end = R, p + T_s * v, v
        rate, force = c.unseen_rate_rad_s_sqrt_hz, c.unseen_acceleration_m_s2_sqrt_hz
        if readings_in_interval is not None:
            rotation, rotation_integral, dv, dp = strapdown(*readings_in_interval)
            R_end, rotation_integral, dv, dp = R @ rotation, R @ rotation_integral, R @ dv, R @ dp
            F[PHI, BG] = -rotation_integral
            rate = max(c.gyro_noise_rad_s_sqrt_hz, inputs.rate_noise or 0.0)
            if inputs.gravity is not None and inputs.specific_force is not None:
                force = max(c.acc_noise_m_s2_sqrt_hz, inputs.force_noise or 0.0)
                p_end, v_end = _propagate(
                    inputs, inputs.gravity, R_end, dv, dp, readings_in_interval[1][:, :3], T_s
                )
                dv_cross = se3.skew(dv)
                # An error of the attitude rotates the integrated forces and the motion of the lever arm.
                dv_gravity = np.array([0.0, 0.0, -inputs.gravity * T_s])
                F[V, PHI] = -se3.skew(v_end - v - dv_gravity)
                F[P, PHI] = -se3.skew(p_end - p - T_s * v - 0.5 * T_s * dv_gravity)
                F[V, BA], F[P, BA] = -rotation_integral, -0.5 * T_s * rotation_integral
                rate_bias_effect = dv_cross @ rotation_integral
                F[V, BG], F[P, BG] = rate_bias_effect / 2.0, rate_bias_effect * (T_s / 6.0)
        covariance = inputs.covariance.copy()
        covariance[:15] = F @ covariance[:15]
        covariance[:, :15] = covariance[:, :15] @ F.T
        covariance[:15, :15] += self._noise(rate, force, T_s)
        # Orthonormalisation: one step of Newton's method for the polar decomposition.
        pose = se3.transform(1.5 * R_end - 0.5 * (R_end @ R_end.T @ R_end), p_end)
        return Outputs(
            pose=pose,
            velocity=v_end,
            covariance=covariance,
            transition=F,
            inertial=readings_in_interval is not None,
        )

    def _noise(self, rate: float, force: float, T_s: float) -> FloatArray:
        """Return the contribution of the noise of rate and force to the covariance (15, 15)."""
        c = self.config
        Q = np.zeros((15, 15))
        Q[P, P], Q[PHI, PHI], Q[V, V] = (
            force**2 * T_s**3 / 3.0 * _EYE,
            rate**2 * T_s * _EYE,
            force**2 * T_s * _EYE,
        )
        Q[P, V] = Q[V, P] = 0.5 * force**2 * T_s**2 * _EYE
        Q[BG, BG], Q[BA, BA] = (
            c.gyro_walk_rad_s2_sqrt_hz**2 * T_s * _EYE,
            c.acc_walk_m_s3_sqrt_hz**2 * T_s * _EYE,
        )
        return Q

    def _readings(self, inputs: Inputs, start: int, end: int) -> tuple[FloatArray, FloatArray] | None:
        """Return the readings of the interval: times (k,), s from the start, and rates and forces (k, 6)
        without biases; None if the readings have a gap.

        Readings at the start and at the end are interpolated. Without measured forces the forces are invalid.
        """
        stamps, rates, forces = inputs.stamps_ns, inputs.rates_rad_s, inputs.specific_force
        if stamps is None or rates is None or not len(stamps) or end == start:
            return None
        first, last = int(stamps.searchsorted(start, "right")), int(stamps.searchsorted(end, "left"))
        around = stamps[max(first - 1, 0) : last + 1]
        gap_ns = self.config.max_gap_s * 1e9
        if not len(around) or around[0] - start > gap_ns or end - around[-1] > gap_ns:
            return None
        if len(around) > 1 and (around[1:] - around[:-1]).max() > gap_ns:
            return None
        readings = np.zeros((len(stamps), 6))
        readings[:, :3] = rates
        if forces is not None:
            readings[:, 3:] = forces
        t_s, readings_in_interval = np.empty(last - first + 2), np.empty((last - first + 2, 6))
        t_s[0], t_s[1:-1], t_s[-1] = 0.0, (stamps[first:last] - start) * 1e-9, (end - start) * 1e-9
        readings_in_interval[0], readings_in_interval[-1] = (
            _interpolate(stamps, readings, first, start),
            _interpolate(stamps, readings, last, end),
        )
        readings_in_interval[1:-1] = readings[first:last]
        return t_s, readings_in_interval - inputs.biases


def _propagate(
    inputs: Inputs,
    gravity: float,
    R_end: FloatArray,
    dv: FloatArray,
    dp: FloatArray,
    rates: FloatArray,
    T_s: float,
) -> tuple[FloatArray, FloatArray]:
    """Return position and velocity of the body at the end; the forces are measured at the lever arm.

    ``dv`` and ``dp`` are the integrals of the specific force in the world, ``rates`` the angular rates (k,
    3).
    """
    R, p, v = inputs.pose[:3, :3], inputs.pose[:3, 3], inputs.velocity
    dv_gravity = np.array([0.0, 0.0, -gravity * T_s])
    if inputs.lever_m is None or not inputs.lever_m.any():
        return p + v * T_s + dp + 0.5 * T_s * dv_gravity, v + dv + dv_gravity
    arm = se3.skew(inputs.lever_m)
    v_sensor = v - R @ (arm @ rates[0])
    v_end = v_sensor + dv + dv_gravity + R_end @ (arm @ rates[-1])
    return p + (R - R_end) @ inputs.lever_m + v_sensor * T_s + dp + 0.5 * T_s * dv_gravity, v_end


def _interpolate(stamps_ns: IntArray, rows: FloatArray, k: int, t_ns: int) -> FloatArray:
    """Return the interpolation between rows k - 1 and k; before the first row the first, after the last the
    last.
    """
    if k == 0 or k == len(rows):
        return np.asarray(rows[max(k - 1, 0)])
    fraction = float(t_ns - stamps_ns[k - 1]) / float(stamps_ns[k] - stamps_ns[k - 1])
    return np.asarray(rows[k - 1] + fraction * (rows[k] - rows[k - 1]))

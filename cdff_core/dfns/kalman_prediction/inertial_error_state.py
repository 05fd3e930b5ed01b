# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""InertialErrorState: strapdown integration and the covariance of its errors."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.kalman_prediction._interface import (
    KalmanPredictionInputs,
    KalmanPredictionInterface,
    KalmanPredictionOutputs,
)

Density = Annotated[float, Field(ge=0, le=10)]
P, PHI, V, BG, BA = (slice(k, k + 3) for k in range(0, 15, 3))


class InertialErrorStateConfig(DfnConfig):
    """Parameters of InertialErrorState: those of a good tactical sensor on a rover that shakes a little."""

    gyro_noise_rad_s_sqrt_hz: Annotated[Density, Field(description="rad/s/sqrt(Hz)")] = 1.6e-4
    gyro_walk_rad_s2_sqrt_hz: Annotated[Density, Field(description="rad/s^2/sqrt(Hz)")] = 6e-6
    acc_noise_m_s2_sqrt_hz: Annotated[Density, Field(description="m/s^2/sqrt(Hz)")] = 3e-3
    acc_walk_m_s3_sqrt_hz: Annotated[Density, Field(description="m/s^3/sqrt(Hz)")] = 1.6e-4
    unseen_acceleration_m_s2_sqrt_hz: Annotated[Density, Field(description="m/s^2/sqrt(Hz)")] = 0.5
    unseen_rate_rad_s_sqrt_hz: Annotated[Density, Field(description="rad/s/sqrt(Hz)")] = 0.3
    max_gap_s: Annotated[float, Field(gt=0, le=10, description="s")] = 0.15


class InertialErrorState(KalmanPredictionInterface):
    """Trapezoidal integration in the frame of the begin, coning to second order, and first-order error transition.

    Notes
    -----
    Rotation errors are taken in the world, ``R_true = Exp(phi) R``, as all covariances here; Solà (2017),
    arXiv:1711.02508, ch. 7 derives the transition. Intervals of up to some tenths of a second are meant: coning of
    higher order is left out.
    """

    Config: ClassVar[type[DfnConfig]] = InertialErrorStateConfig
    config: InertialErrorStateConfig

    def process(self, inputs: KalmanPredictionInputs) -> KalmanPredictionOutputs:
        """Move the state on; raises InputError on arrays that do not fit together or an end before the begin."""
        begin, end = (int(t) for t in inputs.interval_ns)
        if end < begin or inputs.covariance.ndim != 2 or len(inputs.covariance) < 15:
            raise InputError(
                f"interval {begin}..{end}, covariance {inputs.covariance.shape}: expected begin <= end and 15 states"
            )
        T_s = (end - begin) * 1e-9
        felt = self._felt(inputs, begin, end)
        R, p, v = inputs.pose[:3, :3], inputs.pose[:3, 3], inputs.velocity
        F, c = np.eye(15), self.config
        F[P, V] = T_s * np.eye(3)
        q = np.zeros(15)
        if felt is None:
            R_end, p_end, v_end = R, p + T_s * v, v
            rate, force = c.unseen_rate_rad_s_sqrt_hz, c.unseen_acceleration_m_s2_sqrt_hz
        else:
            t_s, rates, forces = felt
            R_end, turned = _turn(R, t_s, rates - inputs.biases[:3])
            F[PHI, BG] = -turned
            rate, force = c.gyro_noise_rad_s_sqrt_hz, c.unseen_acceleration_m_s2_sqrt_hz
            if inputs.gravity is None or forces is None:
                p_end, v_end = p + T_s * v, v
            else:
                force = c.acc_noise_m_s2_sqrt_hz
                dv, dp = _push(R, t_s, rates - inputs.biases[:3], forces - inputs.biases[3:])
                p_end, v_end = self._carried(inputs, R_end, dv, dp, rates, T_s)
                F[V, PHI], F[P, PHI] = -se3.skew(dv), -se3.skew(dp)
                F[V, BA], F[P, BA] = -turned, -0.5 * T_s * turned
                leaning = se3.skew(dv) @ turned
                F[V, BG], F[P, BG] = leaning / 2.0, leaning * T_s / 6.0
        q[PHI], q[V] = rate**2 * T_s, force**2 * T_s
        q[BG], q[BA] = c.gyro_walk_rad_s2_sqrt_hz**2 * T_s, c.acc_walk_m_s3_sqrt_hz**2 * T_s
        q[P] = force**2 * T_s**3 / 3.0
        covariance = inputs.covariance.copy()
        covariance[:15] = F @ covariance[:15]
        covariance[:, :15] = covariance[:, :15] @ F.T
        covariance[range(15), range(15)] += q
        coupled = 0.5 * force**2 * T_s**2
        for k in range(3):
            covariance[k, 6 + k] += coupled
            covariance[6 + k, k] += coupled
        return KalmanPredictionOutputs(
            se3.transform(se3.normalise_rotation(R_end), p_end), v_end, covariance, F, np.asarray(felt is not None)
        )

    def _felt(
        self, inputs: KalmanPredictionInputs, begin: int, end: int
    ) -> tuple[FloatArray, FloatArray, FloatArray | None] | None:
        """Times (s, from the begin), rates and forces at begin, readings and end; None where they leave a gap."""
        stamps, rates, forces = inputs.stamps_ns, inputs.rates_rad_s, inputs.specific_force
        if stamps is None or rates is None or not len(stamps) or end == begin:
            return None
        if rates.shape != (len(stamps), 3) or (forces is not None and forces.shape != rates.shape):
            raise InputError(f"{len(stamps)} stamps, rates {rates.shape}: expected as many rows of 3")
        first, last = int(np.searchsorted(stamps, begin, "right")), int(np.searchsorted(stamps, end, "left"))
        lo, hi = max(first - 1, 0), min(last + 1, len(stamps))
        around = (stamps[lo:hi] - begin) * 1e-9
        span = (end - begin) * 1e-9
        gap = self.config.max_gap_s
        if not len(around) or around[0] > gap or span - around[-1] > gap or np.any(np.diff(around) > gap):
            return None
        t = np.concatenate(([0.0], (stamps[first:last] - begin) * 1e-9, [span]))
        w = np.column_stack([np.interp(t, around, rates[lo:hi, a]) for a in range(3)])
        f = None if forces is None else np.column_stack([np.interp(t, around, forces[lo:hi, a]) for a in range(3)])
        return t, w, f

    @staticmethod
    def _carried(
        inputs: KalmanPredictionInputs, R_end: FloatArray, dv: FloatArray, dp: FloatArray, rates: FloatArray, T_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Position and velocity of the body at the end; the forces are those at the sensor, a lever away."""
        R, p, v = inputs.pose[:3, :3], inputs.pose[:3, 3], inputs.velocity
        down = np.array([0.0, 0.0, -float(inputs.gravity)])  # type: ignore[arg-type]  # the caller has looked
        lever = np.zeros(3) if inputs.lever_m is None else inputs.lever_m
        bias = inputs.biases[:3]
        swing_begin, swing_end = R @ _cross(rates[0] - bias, lever), R_end @ _cross(rates[-1] - bias, lever)
        v_begin = v + swing_begin
        v_end = v_begin + dv + down * T_s - swing_end
        p_end = p + R @ lever + v_begin * T_s + dp + 0.5 * down * T_s**2 - R_end @ lever
        return p_end, v_end


def _turn(R: FloatArray, t_s: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation at the end, and the integral of the rotation over the interval."""
    dt = np.diff(t_s)
    turns = _angles(dt, rates)
    R_k = se3.exp_so3(turns)
    mean = np.tensordot(dt, 0.5 * (R_k[1:] + R_k[:-1]), 1)
    return R @ R_k[-1], R @ mean


def _push(R: FloatArray, t_s: FloatArray, rates: FloatArray, forces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Integral and double integral of the specific force, in the world."""
    dt = np.diff(t_s)
    a = np.einsum("kij,kj->ki", se3.exp_so3(_angles(dt, rates)), forces)
    mean = 0.5 * (a[1:] + a[:-1])
    steps = mean * dt[:, None]
    before = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)[:-1]])
    return R @ steps.sum(axis=0), R @ (before * dt[:, None] + 0.5 * steps * dt[:, None]).sum(axis=0)


def _angles(dt: FloatArray, rates: FloatArray) -> FloatArray:
    """Rotation vectors (k, 3) from the begin to each time, coning to second order."""
    steps = 0.5 * (rates[1:] + rates[:-1]) * dt[:, None]
    sums = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])
    coning = 0.5 * np.cumsum(np.cross(sums[:-1], steps), axis=0)
    sums[1:] += coning
    return sums


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])

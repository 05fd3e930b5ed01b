# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""InertialErrorState: strapdown integration and the covariance of its errors."""

from __future__ import annotations

from typing import Annotated, ClassVar

import numpy as np
from numpy.typing import NDArray
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
from cdff_core.dfns.kalman_prediction._kernels import strapdown

Density = Annotated[float, Field(ge=0, le=10)]
P, PHI, V, BG, BA = (slice(k, k + 3) for k in range(0, 15, 3))
_EYE = np.eye(3)


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

    def setup(self) -> None:
        """Compile."""
        strapdown(np.zeros(1), np.zeros((1, 6)))

    def process(self, inputs: KalmanPredictionInputs) -> KalmanPredictionOutputs:
        """Move the state on; raises InputError on arrays that do not fit together or an end before the begin."""
        begin, end = (int(t) for t in inputs.interval_ns)
        if end < begin or inputs.covariance.ndim != 2 or len(inputs.covariance) < 15:
            raise InputError(
                f"interval {begin}..{end}, covariance {inputs.covariance.shape}: expected begin <= end and 15 states"
            )
        T_s, c = (end - begin) * 1e-9, self.config
        felt = self._felt(inputs, begin, end)
        R, p, v = inputs.pose[:3, :3], inputs.pose[:3, 3], inputs.velocity
        F = np.eye(15)
        F[P, V] = T_s * _EYE
        R_end, p_end, v_end = R, p + T_s * v, v
        rate, force = c.unseen_rate_rad_s_sqrt_hz, c.unseen_acceleration_m_s2_sqrt_hz
        if felt is not None:
            turn, turned, dv, dp = strapdown(*felt)
            R_end, turned, dv, dp = R @ turn, R @ turned, R @ dv, R @ dp
            F[PHI, BG] = -turned
            rate = c.gyro_noise_rad_s_sqrt_hz
            if inputs.gravity is not None and inputs.specific_force is not None:
                force = c.acc_noise_m_s2_sqrt_hz
                p_end, v_end = _carried(inputs, R_end, dv, dp, felt[1][:, :3], T_s)
                leaning = se3.skew(dv)
                F[V, PHI], F[P, PHI] = -leaning, -se3.skew(dp)
                F[V, BA], F[P, BA] = -turned, -0.5 * T_s * turned
                leaning = leaning @ turned
                F[V, BG], F[P, BG] = leaning / 2.0, leaning * (T_s / 6.0)
        covariance = inputs.covariance.copy()
        covariance[:15] = F @ covariance[:15]
        covariance[:, :15] = covariance[:, :15] @ F.T
        covariance[:15, :15] += self._noise(rate, force, T_s)
        # What rounding took from a rotation: a step of Newton's method for its polar decomposition.
        pose = se3.transform(1.5 * R_end - 0.5 * (R_end @ R_end.T @ R_end), p_end)
        return KalmanPredictionOutputs(pose, v_end, covariance, F, np.asarray(felt is not None))

    def _noise(self, rate: float, force: float, T_s: float) -> FloatArray:
        """What the noise of rate and force adds to the covariance (15, 15)."""
        c = self.config
        Q = np.zeros((15, 15))
        Q[P, P], Q[PHI, PHI], Q[V, V] = force**2 * T_s**3 / 3.0 * _EYE, rate**2 * T_s * _EYE, force**2 * T_s * _EYE
        Q[P, V] = Q[V, P] = 0.5 * force**2 * T_s**2 * _EYE
        Q[BG, BG], Q[BA, BA] = c.gyro_walk_rad_s2_sqrt_hz**2 * T_s * _EYE, c.acc_walk_m_s3_sqrt_hz**2 * T_s * _EYE
        return Q

    def _felt(self, inputs: KalmanPredictionInputs, begin: int, end: int) -> tuple[FloatArray, FloatArray] | None:
        """Times (k,), s from the begin, and rates and forces (k, 6) free of biases, from begin to end.

        Returns
        -------
        None where the readings leave a gap; forces that were not felt are 0 less their bias.
        """
        stamps, rates, forces = inputs.stamps_ns, inputs.rates_rad_s, inputs.specific_force
        if stamps is None or rates is None or not len(stamps) or end == begin:
            return None
        if rates.shape != (len(stamps), 3) or (forces is not None and forces.shape != rates.shape):
            raise InputError(f"{len(stamps)} stamps, rates {rates.shape}: expected as many rows of 3")
        first, last = int(stamps.searchsorted(begin, "right")), int(stamps.searchsorted(end, "left"))
        around = stamps[max(first - 1, 0) : last + 1]
        gap_ns = self.config.max_gap_s * 1e9
        if not len(around) or around[0] - begin > gap_ns or end - around[-1] > gap_ns:
            return None
        if len(around) > 1 and (around[1:] - around[:-1]).max() > gap_ns:
            return None
        readings = np.zeros((len(stamps), 6))
        readings[:, :3] = rates
        if forces is not None:
            readings[:, 3:] = forces
        t_s, felt = np.empty(last - first + 2), np.empty((last - first + 2, 6))
        t_s[0], t_s[1:-1], t_s[-1] = 0.0, (stamps[first:last] - begin) * 1e-9, (end - begin) * 1e-9
        felt[0], felt[-1] = _between(stamps, readings, first, begin), _between(stamps, readings, last, end)
        felt[1:-1] = readings[first:last]
        return t_s, felt - inputs.biases


def _carried(
    inputs: KalmanPredictionInputs, R_end: FloatArray, dv: FloatArray, dp: FloatArray, rates: FloatArray, T_s: float
) -> tuple[FloatArray, FloatArray]:
    """Position and velocity of the body at the end; the forces are those at the sensor, which the body swings."""
    R, p, v = inputs.pose[:3, :3], inputs.pose[:3, 3], inputs.velocity
    fall = np.array([0.0, 0.0, -float(inputs.gravity) * T_s])  # type: ignore[arg-type]  # the caller has looked
    if inputs.lever_m is None or not inputs.lever_m.any():
        return p + v * T_s + dp + 0.5 * T_s * fall, v + dv + fall
    arm = se3.skew(inputs.lever_m)
    v_begin = v - R @ (arm @ rates[0])
    v_end = v_begin + dv + fall + R_end @ (arm @ rates[-1])
    return p + (R - R_end) @ inputs.lever_m + v_begin * T_s + dp + 0.5 * T_s * fall, v_end


def _between(stamps_ns: NDArray[np.int64], rows: FloatArray, k: int, t_ns: int) -> FloatArray:
    """What lies between rows k - 1 and k at a time; before the first row and after the last that one."""
    if k == 0 or k == len(rows):
        return rows[max(k - 1, 0)]
    share = float(t_ns - stamps_ns[k - 1]) / float(stamps_ns[k] - stamps_ns[k - 1])
    return rows[k - 1] + share * (rows[k] - rows[k - 1])

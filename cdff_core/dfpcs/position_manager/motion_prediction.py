# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the motion by the IMU, or by constant velocity without it, and of the slip."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.kalman_prediction.interface import KalmanPredictionInputs
from cdff_core.dfpcs.position_manager.configuration import PositionManagerConfig
from cdff_core.dfpcs.position_manager.estimate import POSE, SLIP, Estimate
from cdff_core.dfpcs.position_manager.imu_buffer import ImuBuffer
from cdff_core.dfpcs.position_manager.mount_errors import with_imu_mount_error

#: Standard deviation of an unknown velocity (without IMU, or after refused increments): that of a car.
UNKNOWN_SPEED_SIGMA_M_S = 15.0
#: Time constant of slip, seconds.
_SLIP_TIME_S = 6.0
#: Longest step of the strapdown integration, nanoseconds.
_STEP_NS = 200_000_000
#: Bounds after a silence on the standard deviations of position (numerical precision) and rotation (unknown).
_LOST_M, _LOST_RAD = 1e4, math.pi / math.sqrt(3.0)


class MotionPrediction:
    """Predicts estimates to later times; its only state is the strength of gravity."""

    def __init__(self, config: PositionManagerConfig, dfn: Dfn[Any, Any, Any], imu: ImuBuffer) -> None:
        self._config, self._dfn, self._imu = config, dfn, imu
        #: Strength of gravity, m/s^2; None until it was measured.
        self.gravity_m_s2: float | None = None

    def predict(self, estimate: Estimate, stamp_ns: int) -> Estimate:
        """Return the estimate at a later time."""
        if stamp_ns - estimate.stamp_ns > self._config.clock.max_silence_s * 1e9:
            return self._predict_over_silence(estimate, stamp_ns)
        while estimate.stamp_ns < stamp_ns:
            estimate = self._integrate(estimate, min(stamp_ns, estimate.stamp_ns + _STEP_NS))
        return estimate

    def _predict_over_silence(self, estimate: Estimate, end_ns: int) -> Estimate:
        """Predict in one step: the robot is assumed to be at rest, and its pose becomes nearly unknown."""
        previous = estimate.covariance[POSE, POSE]
        at_rest = replace(estimate, velocity=np.zeros(3)).with_velocity_sigma(0.0)
        predicted_estimate = self._integrate(at_rest, end_ns)
        P = predicted_estimate.covariance.copy()
        covariance_of_lost_pose = np.diag(np.square([_LOST_M] * 3 + [_LOST_RAD] * 3))
        P[POSE, POSE] = previous + np.minimum(P[POSE, POSE] - previous, covariance_of_lost_pose)
        return replace(predicted_estimate, covariance=P).with_velocity_sigma(UNKNOWN_SPEED_SIGMA_M_S)

    def _integrate(self, estimate: Estimate, end_ns: int) -> Estimate:
        """Integrate the IMU readings to a time (prediction)."""
        stamps, forces, rates = self._imu.around(estimate.stamp_ns, end_ns)
        force_noise, rate_noise = self._imu.noise(end_ns)
        R = se3.exp_so3(estimate.mount_error("imu"))
        out = self._dfn.process(
            KalmanPredictionInputs(
                pose=estimate.pose,
                velocity=estimate.velocity,
                biases=estimate.biases,
                covariance=estimate.covariance,
                interval_ns=np.array([estimate.stamp_ns, end_ns]),
                stamps_ns=stamps,
                specific_force=forces @ R.T,
                rates_rad_s=rates @ R.T,
                gravity=self.gravity_m_s2,
                lever_m=self._imu.lever_m,
                force_noise=force_noise,
                rate_noise=rate_noise,
            )
        )
        # First-order Gauss-Markov process of slip.
        decay = math.exp(-(end_ns - estimate.stamp_ns) * 1e-9 / _SLIP_TIME_S)
        P, cross = out.covariance, estimate.cross_covariance.copy()
        P[SLIP] *= decay
        P[:, SLIP] *= decay
        P[range(15, 18), range(15, 18)] += np.square(self._config.wheels.slip_sigma) * (1.0 - decay**2)
        cross[:15] = out.transition @ cross[:15]
        cross[SLIP] *= decay
        predicted_estimate = replace(
            estimate,
            stamp_ns=end_ns,
            pose=out.pose,
            velocity=out.velocity,
            slip=estimate.slip * decay,
            covariance=P,
            cross_covariance=cross,
        )
        return (
            with_imu_mount_error(estimate, predicted_estimate, self.gravity_m_s2)
            if out.inertial
            else predicted_estimate
        )

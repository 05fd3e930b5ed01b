# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the state of a tracked body, and start of a track: shared by the trackers."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from pydantic import Field, field_validator

from cdff_common.arrays import FloatArray
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.dfns.kalman_correction.interface import KalmanCorrectionInputs
from cdff_core.dfns.target_state_prediction.interface import TargetStatePredictionInputs
from cdff_core.object_models.inertia import inertia_of
from cdff_core.object_models.tracked_state import STATE_ERROR_DIM, TrackedState

#: A measured pose is the first six errors of the state.
_JACOBIAN = np.eye(6, STATE_ERROR_DIM)
#: Adaptation of the noise: gain, largest excess of a squared normalised correction, bounds of the factors,
#: and relative decrease of a variance above which its direction was measured.
_GAIN, _MAX_EXCESS, _MIN_SCALE, _MAX_SCALE, _LEAST_DECREASE = 0.3, 3.0, 0.3, 300.0, 0.02


class NewTrackConfig(DfpcConfig):
    """Parameters of the start of a track."""

    initial_velocity_sigma_mps: float = Field(
        0.3, gt=0, le=100, description="Standard deviation of the velocity of a new track"
    )
    initial_rate_sigma_radps: float = Field(
        0.2, gt=0, le=10, description="Standard deviation of the angular rate of a new track"
    )
    initial_rate_radps: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Angular rate of a new track, relative to the sensor, in the body's axes"
    )
    inertia_ratios: tuple[float, float, float] = Field(
        (1.0, 1.0, 1.0), description="Principal moments of inertia along the axes of the body, up to a factor"
    )
    inertia_sigma: float = Field(
        0.15,
        ge=0,
        le=1,
        description="Standard deviation of the inertia relative to the mean moment; 0 if it is known",
    )
    confirm_after: int = Field(
        3, ge=1, le=100, description="Number of used measurements from which the track is confirmed"
    )
    lost_after_s: float = Field(
        120.0, gt=0, le=1e5, description="Time without a used measurement after which the track is lost"
    )

    @field_validator("inertia_ratios")
    @classmethod
    def _is_a_body(cls, ratios: tuple[float, float, float]) -> tuple[float, float, float]:
        """Raise ValueError if moments of inertia with these ratios belong to no rigid body."""
        low, middle, high = sorted(ratios)
        if low <= 0.0 or high > low + middle:
            raise ValueError("expected moments above 0, none above the sum of the other two")
        return ratios


class StateFilter:
    """Error-state Kalman filter of one body.

    Parameters
    ----------
    predict, correct : Dfn
        TargetStatePrediction and KalmanCorrection.
    config : NewTrackConfig
    centre_of_mass_m : ndarray, shape (3,)
        In the frame of the body.
    centre_of_mass_sigma_m : float
        Its standard deviation; 0 if it is known.
    """

    def __init__(
        self,
        predict: Dfn[Any, Any, Any],
        correct: Dfn[Any, Any, Any],
        config: NewTrackConfig,
        centre_of_mass_m: FloatArray,
        centre_of_mass_sigma_m: float,
    ) -> None:
        self._predict, self._correct, self._config = predict, correct, config
        self._centre_m, self._centre_sigma_m = (
            np.asarray(centre_of_mass_m, np.float64),
            centre_of_mass_sigma_m,
        )

    def start(self, stamp_ns: int, T_sensor_body: FloatArray, pose_covariance: FloatArray) -> TrackedState:
        """Return the state of a measured pose without knowledge of its motion."""
        covariance = np.zeros((STATE_ERROR_DIM, STATE_ERROR_DIM))
        covariance[:6, :6] = pose_covariance
        covariance[6:9, 6:9] = self._config.initial_velocity_sigma_mps**2 * np.eye(3)
        covariance[9:12, 9:12] = self._config.initial_rate_sigma_radps**2 * np.eye(3)
        covariance[12:15, 12:15] = self._centre_sigma_m**2 * np.eye(3)
        covariance[15:, 15:] = self._config.inertia_sigma**2 * np.eye(5)
        rate = np.array(self._config.initial_rate_radps)
        inertia = inertia_of(self._config.inertia_ratios)
        return TrackedState(stamp_ns, T_sensor_body, np.zeros(3), rate, self._centre_m, inertia, covariance)

    def predicted(self, state: TrackedState, stamp_ns: int) -> TrackedState:
        """Return the state at a later time."""
        return self.prediction(state, stamp_ns)[0]

    def prediction(self, state: TrackedState, stamp_ns: int) -> tuple[TrackedState, FloatArray]:
        """Return the state at a later time and the derivative (20, 20) of its errors."""
        outputs = self._predict.process(
            TargetStatePredictionInputs(
                pose=state.T,
                velocity=state.velocity,
                rate=state.rate,
                centre_of_mass_m=state.centre_of_mass_m,
                inertia=state.inertia,
                covariance=state.covariance,
                noise_scales=state.noise_scales,
                duration_s=1e-9 * (stamp_ns - state.stamp_ns),
            )
        )
        predicted_state = TrackedState(
            stamp_ns,
            outputs.pose,
            outputs.velocity,
            outputs.rate,
            state.centre_of_mass_m,
            state.inertia,
            outputs.covariance,
            state.noise_scales,
        )
        return predicted_state, outputs.transition

    def corrected(
        self, predicted: TrackedState, T_measured: FloatArray, covariance: FloatArray
    ) -> TrackedState:
        """Return the state after a measured pose (4, 4) with covariance (6, 6).

        Raises
        ------
        RefusedError
            ``innovation:X>Y`` if it contradicts the prediction.
        """
        outputs = self._correct.process(
            KalmanCorrectionInputs(
                residual=pose_error(T_measured, predicted.T),
                jacobian=_JACOBIAN,
                noise=covariance,
                covariance=predicted.covariance,
            )
        )
        return adapt_noise(predicted, predicted.corrected(outputs.correction, outputs.covariance))


def adapt_noise(predicted: TrackedState, corrected: TrackedState) -> TrackedState:
    """Return the corrected state with the noise of its accelerations adapted to the size of the correction.

    The covariance of a correction is the decrease of that of the state (Mehra 1970,
    doi:10.1109/TAC.1970.1099422). The noise grows fast and decays slowly.
    """
    error = corrected.difference(predicted)
    decrease = predicted.covariance - corrected.covariance
    excess = []
    for rows in (slice(0, 3), slice(3, 6)):
        values, vectors = np.linalg.eigh(decrease[rows, rows])
        is_informed = values > _LEAST_DECREASE * np.diag(predicted.covariance)[rows].max()
        squares = (vectors.T @ error[rows])[is_informed] ** 2 / values[is_informed]
        excess.append(float(np.mean(squares)) - 1.0 if is_informed.any() else 0.0)
    return replace(corrected, noise_scales=_scale_noise(predicted.noise_scales, np.array(excess)))


def with_rejection(predicted: TrackedState) -> TrackedState:
    """Return the state after a measurement beyond the gate: the noise of its accelerations grows."""
    return replace(predicted, noise_scales=_scale_noise(predicted.noise_scales, np.full(2, _MAX_EXCESS)))


def _scale_noise(scales: FloatArray, excess: FloatArray) -> FloatArray:
    """Return the noise scales, moved towards the excess of the residuals within bounds."""
    changed_scales = scales * np.exp(_GAIN * np.clip(excess, -1.0, _MAX_EXCESS))
    return np.asarray(np.clip(changed_scales, _MIN_SCALE, _MAX_SCALE))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Prediction of the state of a tracked body, and start of a track: shared by the trackers."""

from __future__ import annotations

from typing import Any

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfn import Dfn
from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.dfns.kalman_correction.interface import KalmanCorrectionInputs
from cdff_core.dfns.target_state_prediction.interface import TargetStatePredictionInputs
from cdff_core.object_models.tracked_state import ERRORS, TrackedState

#: A measured pose is the first six errors of the state.
_JACOBIAN = np.eye(6, ERRORS)


class NewTrackConfig(DfpcConfig):
    """Parameters of the start of a track."""

    initial_velocity_sigma_mps: float = Field(
        0.3, gt=0, le=100, description="Standard deviation of the velocity of a new track"
    )
    initial_rate_sigma_radps: float = Field(
        0.2, gt=0, le=10, description="Standard deviation of the angular rate of a new track"
    )
    confirm_after: int = Field(
        3, ge=1, le=100, description="Number of used measurements from which the track is confirmed"
    )
    lost_after_s: float = Field(
        120.0, gt=0, le=1e5, description="Time without a used measurement after which the track is lost"
    )


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

    def start(self, stamp_ns: int, T: FloatArray, pose_covariance: FloatArray) -> TrackedState:
        """Return the state of a measured pose without knowledge of its motion."""
        covariance = np.zeros((ERRORS, ERRORS))
        covariance[:6, :6] = pose_covariance
        covariance[6:9, 6:9] = self._config.initial_velocity_sigma_mps**2 * np.eye(3)
        covariance[9:12, 9:12] = self._config.initial_rate_sigma_radps**2 * np.eye(3)
        covariance[12:, 12:] = self._centre_sigma_m**2 * np.eye(3)
        return TrackedState(stamp_ns, T, np.zeros(3), np.zeros(3), self._centre_m, covariance)

    def predicted(self, state: TrackedState, stamp_ns: int) -> TrackedState:
        """Return the state at a later time."""
        outputs = self._predict.process(
            TargetStatePredictionInputs(
                pose=state.T,
                velocity=state.velocity,
                rate=state.rate,
                centre_of_mass_m=state.centre_of_mass_m,
                covariance=state.covariance,
                duration_s=1e-9 * (stamp_ns - state.stamp_ns),
            )
        )
        return TrackedState(
            stamp_ns,
            outputs.pose,
            outputs.velocity,
            outputs.rate,
            state.centre_of_mass_m,
            outputs.covariance,
        )

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
        return predicted.corrected(outputs.correction, outputs.covariance)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Filter of directions with constant angular velocity."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.bearing_tracking.motion import BearingStates, is_observed, predict_states, update_states
from cdff_core.dfns.bearing_filtering.interface import Inputs, Interface, Outputs


class ConstantAngularVelocityConfig(DfnConfig):
    """Parameters of ConstantAngularVelocity."""

    noise_rad2_s3: float = Field(
        1e-14, ge=0.0, le=1.0, description="Spectral density of the angular acceleration, rad²/s³"
    )


class ConstantAngularVelocity(Interface[ConstantAngularVelocityConfig]):
    """Kalman filter on the sphere, see ``cdff_core.bearing_tracking.motion``."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the predicted, and where measured corrected, states.

        Raises
        ------
        InputError
            If the interval is negative or not finite, or measurements lack their covariances.
        """
        if not (np.isfinite(inputs.interval) and inputs.interval >= 0.0):
            raise InputError(f"interval={inputs.interval}: expected seconds, at least 0")
        states = predict_states(
            BearingStates(inputs.directions, inputs.rates, inputs.covariances),
            inputs.interval,
            self.config.noise_rad2_s3,
        )
        nis = np.full(len(states), np.nan)
        if inputs.measured is not None:
            if inputs.measured_covariances is None:
                raise InputError("measuredCovariances: None, expected one matrix for each measured direction")
            observed_rows = np.flatnonzero(is_observed(inputs.measured))
            corrected, nis[observed_rows], _ = update_states(
                states.selected(observed_rows),
                inputs.measured[observed_rows],
                inputs.measured_covariances[observed_rows],
            )
            states = _replace_rows(states, observed_rows, corrected)
        return Outputs(
            directions=states.directions, rates=states.rates, covariances=states.covariances, nis=nis
        )


def _replace_rows(states: BearingStates, indices: np.ndarray, parts: BearingStates) -> BearingStates:
    """Return the states with the rows at ``indices`` replaced by ``parts``."""
    directions, rates, covariances = (
        states.directions.copy(),
        states.rates.copy(),
        states.covariances.copy(),
    )
    directions[indices], rates[indices], covariances[indices] = (
        parts.directions,
        parts.rates,
        parts.covariances,
    )
    return BearingStates(directions, rates, covariances)

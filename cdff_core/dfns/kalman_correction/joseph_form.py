# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kalman correction whose covariance remains symmetric and positive semi-definite despite rounding."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import RefusedError
from cdff_common.geometry.robust import chi_squared_quantile
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.kalman_correction.interface import Inputs, Interface, Outputs


class JosephFormConfig(DfnConfig):
    """Parameters of JosephForm."""

    gate_probability: float = Field(
        0.9999, gt=0.5, lt=1, description="Probability that a correct measurement passes the gate"
    )


class JosephForm(Interface[JosephFormConfig]):
    """Kalman correction in the form of Bucy and Joseph (1968), with a chi-squared gate on the innovation.

    Rows of the gain of considered errors are zero (Schmidt-Kalman filter, Schmidt 1966).
    The covariance is ``(I - K H) P (I - K H)^T + K N K^T`` with gain K, Jacobian H and measurement noise N.
    """

    def setup(self) -> None:
        """Clear the limits of the gate, which are computed on demand for each number of measurements."""
        self._limits: dict[int, float] = {}

    def process(self, inputs: Inputs) -> Outputs:
        """Return the correction; raises RefusedError if the measurement contradicts the state."""
        r, H, N, P = inputs.residual, inputs.jacobian, inputs.noise, inputs.covariance
        m = len(r)
        PH = P @ H.T
        S = H @ PH + N
        S_inverse_r_and_HP = np.linalg.solve(S, np.concatenate([r[:, None], PH.T], axis=1))
        innovation = float(r @ S_inverse_r_and_HP[:, 0])
        if m not in self._limits:
            self._limits[m] = chi_squared_quantile(self.config.gate_probability, m)
        limit = self._limits[m]
        if not innovation <= limit:
            raise RefusedError(
                f"innovation {innovation:.3g} of {m} measurements, expected below {limit:.3g}",
                [f"innovation:{innovation:.3g}>{limit:.3g}"],
            )
        K = S_inverse_r_and_HP[:, 1:].T
        if inputs.considered is not None:
            K[inputs.considered] = 0.0
        # The terms of the class docstring multiplied out, with S = H P H^T + N.
        KP = K @ PH.T
        covariance = P - KP - KP.T + K @ S @ K.T
        return Outputs(
            correction=K @ r,
            covariance=0.5 * (covariance + covariance.T),
            gain=K,
            innovation=innovation,
        )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Kalman correction with a covariance that stays symmetric and positive despite rounding."""

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
        0.9999, gt=0.5, lt=1, description="Probability that a correct measurement passes"
    )


class JosephForm(Interface[JosephFormConfig]):
    """``P = (I - K H) P (I - K H)^T + K R K^T``: Bucy and Joseph (1968); the gate is on the innovation."""

    def setup(self) -> None:
        """Reset the limits of the gate, which are computed per number of measurements on demand."""
        self._limits: dict[int, float] = {}

    def process(self, inputs: Inputs) -> Outputs:
        """Return the correction; raises RefusedError on a contradicting measurement."""
        r, H, N, P = inputs.residual, inputs.jacobian, inputs.noise, inputs.covariance
        m = len(r)
        PH = P @ H.T
        S = H @ PH + N
        solved = np.linalg.solve(S, np.concatenate([r[:, None], PH.T], axis=1))
        innovation = float(r @ solved[:, 0])
        if m not in self._limits:
            self._limits[m] = chi_squared_quantile(self.config.gate_probability, m)
        limit = self._limits[m]
        if not innovation <= limit:
            raise RefusedError(
                f"innovation {innovation:.3g} of {m} measurements, expected below {limit:.3g}",
                [f"innovation:{innovation:.3g}>{limit:.3g}"],
            )
        K = solved[:, 1:].T
        # (I - K H) P (I - K H)^T + K N K^T, multiplied out: K S K^T is formed once.
        KP = K @ PH.T
        covariance = P - KP - KP.T + K @ S @ K.T
        return Outputs(
            correction=K @ r,
            covariance=0.5 * (covariance + covariance.T),
            gain=K,
            innovation=innovation,
        )

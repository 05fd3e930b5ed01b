# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""JosephForm: the Kalman filter's correction, its covariance symmetric and positive whatever is rounded."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field
from scipy.stats import chi2

from cdff_common.errors import InputError, RefusedError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.kalman_correction._interface import (
    KalmanCorrectionInputs,
    KalmanCorrectionInterface,
    KalmanCorrectionOutputs,
)


class JosephFormConfig(DfnConfig):
    """Which measurements are believed."""

    gate_probability: float = Field(0.9999, gt=0.5, lt=1.0, description="Share of right measurements that pass")


class JosephForm(KalmanCorrectionInterface):
    """``P = (I - K H) P (I - K H)^T + K R K^T``: Bucy and Joseph (1968); the gate is on the innovation."""

    Config: ClassVar[type[DfnConfig]] = JosephFormConfig
    config: JosephFormConfig

    def setup(self) -> None:
        """Limits of the gate by the number of measurements, as they are needed."""
        self._limits: dict[int, float] = {}

    def process(self, inputs: KalmanCorrectionInputs) -> KalmanCorrectionOutputs:
        """Correct; raises InputError, or RefusedError where the measurement contradicts the state."""
        r, H, N, P = inputs.residual, inputs.jacobian, inputs.noise, inputs.covariance
        m, n = H.shape
        if r.shape != (m,) or N.shape != (m, m) or P.shape != (n, n):
            raise InputError(
                f"residual {r.shape}, jacobian {H.shape}, noise {N.shape}, covariance {P.shape}: expected (m,), "
                "(m, n), (m, m), (n, n)"
            )
        PH = P @ H.T
        S = H @ PH + N
        solved = np.linalg.solve(S, np.concatenate([r[:, None], PH.T], axis=1))
        innovation = float(r @ solved[:, 0])
        if m not in self._limits:
            self._limits[m] = float(chi2.ppf(self.config.gate_probability, m))
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
        return KalmanCorrectionOutputs(K @ r, 0.5 * (covariance + covariance.T), K, np.asarray(innovation))

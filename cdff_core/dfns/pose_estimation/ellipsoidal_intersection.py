# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Combination of two poses with possibly correlated errors."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.robust import chi_squared_quantile
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.pose_estimation.interface import Inputs, Interface, Outputs

#: Added to variances, so that singular covariances can be compared.
_LEAST_VARIANCE = 1e-12


class EllipsoidalIntersectionConfig(DfnConfig):
    """Parameters of EllipsoidalIntersection."""

    gate_probability: float = Field(
        0.9999, gt=0.5, lt=1, description="Probability that a correct measurement passes"
    )


class EllipsoidalIntersection(Interface[EllipsoidalIntersectionConfig]):
    """Selection of the estimate with the smaller variance along each common direction of both covariances.

    Notes
    -----
    Sijs and Lazar (2012), doi:10.1016/j.automatica.2012.05.004. Measurements against one map share the map's
    errors: a Kalman filter would treat repeated measurements as independent and become overconfident. Here
    the
    covariance of a robot at rest stays that of one measurement. The gate is that of a Kalman filter on the
    innovation.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the joined pose; raises InputError, or RefusedError where both contradict each other."""
        cfg = self.config
        first, C_first = _checked(inputs.prediction, inputs.prediction_covariance)
        second, C_second = _checked(inputs.measurement, inputs.measurement_covariance)
        z = pose_error(second, first)
        innovation = float(z @ np.linalg.solve(C_first + C_second, z))
        limit = chi_squared_quantile(cfg.gate_probability, 6)
        if innovation > limit:
            raise RefusedError(
                f"the measurement lies {np.linalg.norm(z[:3]):.3g} m and "
                f"{np.degrees(np.linalg.norm(z[3:])):.3g} deg "
                f"from the prediction, {innovation:.3g} in squared deviations, expected below {limit:.3g}",
                [f"innovation:{innovation:.3g}>{limit:.3g}"],
            )
        # In the coordinates y, W y = x, the prediction has unit covariance and the measurement a diagonal
        # one.
        L = np.linalg.cholesky(C_first)
        half = np.linalg.solve(L, C_second)
        variance, U = np.linalg.eigh(np.linalg.solve(L, half.T))
        W = L @ U
        better = variance < 1.0
        step = W @ np.where(better, np.linalg.solve(W, z), 0.0)
        pose = se3.transform(se3.exp_so3(step[3:]) @ first[:3, :3], first[:3, 3] + step[:3])
        C = (W * np.clip(variance, 0.0, 1.0)) @ W.T
        return Outputs(
            pose=pose,
            covariance=0.5 * (C + C.T),
            innovation=innovation,
            measured_directions=int(np.count_nonzero(better)),
        )


def _checked(T: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    pose = UncertainTransform(T, covariance)
    return pose.matrix, np.asarray(pose.covariance) + _LEAST_VARIANCE * np.eye(6)

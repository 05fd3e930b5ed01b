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

#: Added to all variances, so that singular covariances can be inverted.
_MIN_VARIANCE = 1e-12


class EllipsoidalIntersectionConfig(DfnConfig):
    """Parameters of EllipsoidalIntersection."""

    gate_probability: float = Field(
        0.9999, gt=0.5, lt=1, description="Probability that a correct measurement passes"
    )


class EllipsoidalIntersection(Interface[EllipsoidalIntersectionConfig]):
    """Select the estimate with the smaller variance along each common direction of both covariances.

    Notes
    -----
    Sijs and Lazar (2012), doi:10.1016/j.automatica.2012.05.004. Measurements against the same map
    have the errors of the map in common: a Kalman filter would treat repeated measurements as independent and
    become overconfident. Here the covariance of a robot at rest remains that of one measurement. The gate on
    the innovation is that of a Kalman filter.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the combined pose; raises InputError, or RefusedError if prediction and measurement
        contradict each other.
        """
        cfg = self.config
        T_prediction, C_prediction = _pose_and_covariance(inputs.prediction, inputs.prediction_covariance)
        T_measurement, C_measurement = _pose_and_covariance(inputs.measurement, inputs.measurement_covariance)
        z = pose_error(T_measurement, T_prediction)
        innovation = float(z @ np.linalg.solve(C_prediction + C_measurement, z))
        limit = chi_squared_quantile(cfg.gate_probability, 6)
        if innovation > limit:
            raise RefusedError(
                f"the measurement lies {np.linalg.norm(z[:3]):.3g} m and "
                f"{np.degrees(np.linalg.norm(z[3:])):.3g} deg "
                f"from the prediction, squared Mahalanobis distance {innovation:.3g}, "
                f"expected at most {limit:.3g}",
                [f"innovation:{innovation:.3g}>{limit:.3g}"],
            )
        # In the coordinates y with W y = x, the covariance of the prediction is the identity, that of the
        # measurement diagonal.
        L = np.linalg.cholesky(C_prediction)
        L_inv_C = np.linalg.solve(L, C_measurement)
        variance, U = np.linalg.eigh(np.linalg.solve(L, L_inv_C.T))
        W = L @ U
        from_measurement = variance < 1.0
        step = W @ np.where(from_measurement, np.linalg.solve(W, z), 0.0)
        pose = se3.transform(se3.exp_so3(step[3:]) @ T_prediction[:3, :3], T_prediction[:3, 3] + step[:3])
        C = (W * np.clip(variance, 0.0, 1.0)) @ W.T
        return Outputs(
            pose=pose,
            covariance=0.5 * (C + C.T),
            innovation=innovation,
            measured_directions=int(np.count_nonzero(from_measurement)),
        )


def _pose_and_covariance(T: FloatArray, covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return a pose (4, 4) and its regularised covariance (6, 6)."""
    pose = UncertainTransform(T, covariance)
    return pose.matrix, np.asarray(pose.covariance) + _MIN_VARIANCE * np.eye(6)

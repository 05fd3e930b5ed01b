# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Join two poses whose errors may have causes in common."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.stats import chi2

from cdff_common.errors import RefusedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.pose_estimation._interface import (
    PoseEstimationInputs,
    PoseEstimationInterface,
    PoseEstimationOutputs,
)

#: Added to variances before they are compared, so that what is known exactly can be compared at all.
_LEAST_VARIANCE = 1e-12


class EllipsoidalIntersectionConfig(DfnConfig):
    """Which measurements are believed."""

    gate_probability: float = Field(0.9999, gt=0.5, lt=1.0, description="Share of right measurements that pass")


class EllipsoidalIntersection(PoseEstimationInterface):
    """Along each direction that both covariances have in common, believe the one that knows better.

    Notes
    -----
    Sijs and Lazar (2012), doi:10.1016/j.automatica.2012.05.004. Measurements against one map share the map's errors: a
    Kalman filter would take their repetition for new knowledge and end far too confident. Here a robot that stands
    still stays as uncertain as one measurement leaves it. The gate is that of a Kalman filter on the innovation.
    """

    Config: ClassVar[type[DfnConfig]] = EllipsoidalIntersectionConfig

    def process(self, inputs: PoseEstimationInputs) -> PoseEstimationOutputs:
        """Return the joined pose; raises InputError, or RefusedError where both contradict each other."""
        cfg: Any = self.config
        first, C_first = _checked(inputs.prediction, inputs.prediction_covariance)
        second, C_second = _checked(inputs.measurement, inputs.measurement_covariance)
        z = pose_error(second, first)
        innovation = float(z @ np.linalg.solve(C_first + C_second, z))
        limit = float(chi2.ppf(cfg.gate_probability, 6))
        if innovation > limit:
            raise RefusedError(
                f"the measurement lies {np.linalg.norm(z[:3]):.3g} m and {np.degrees(np.linalg.norm(z[3:])):.3g} deg "
                f"from the prediction, {innovation:.3g} in squared deviations, expected below {limit:.3g}",
                [f"innovation:{innovation:.3g}>{limit:.3g}"],
            )
        # In the coordinates y, W y = x, the prediction has unit covariance and the measurement a diagonal one.
        L = np.linalg.cholesky(C_first)
        half = np.linalg.solve(L, C_second)
        variance, U = np.linalg.eigh(np.linalg.solve(L, half.T))
        W = L @ U
        better = variance < 1.0
        step = W @ np.where(better, np.linalg.solve(W, z), 0.0)
        pose = se3.transform(se3.exp_so3(step[3:]) @ first[:3, :3], first[:3, 3] + step[:3])
        C = (W * np.clip(variance, 0.0, 1.0)) @ W.T
        return PoseEstimationOutputs(
            pose=pose,
            covariance=0.5 * (C + C.T),
            innovation=np.array(innovation),
            measured_directions=np.array(np.count_nonzero(better)),
        )


def _checked(T: NDArray[np.float64], covariance: NDArray[np.float64]) -> tuple[NDArray[np.float64], Any]:
    pose = UncertainTransform(T, covariance)
    return pose.matrix, pose.covariance + _LEAST_VARIANCE * np.eye(6)

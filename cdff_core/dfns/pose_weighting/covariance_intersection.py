# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Covariance intersection of two poses with unknown correlation."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.covariance import pose_error
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.pose_weighting.interface import Inputs, Interface, Outputs

#: Added to variances, so that singular covariances can be compared.
_LEAST_VARIANCE = 1e-14
_HALVINGS = 40


class CovarianceIntersection(Interface[DfnConfig]):
    """``C^-1 = w C1^-1 + (1 - w) C2^-1`` with the weight of the smallest determinant.

    Notes
    -----
    Julier and Uhlmann (1997), doi:10.1109/ACC.1997.609105: the covariance is an upper bound whatever the two
    errors share. The determinant does not depend on the units of metres and radians. In the coordinates in
    which the first has unit covariance and the second a diagonal one, its derivative by w is a sum of six
    decreasing terms, whose root is found by bisection.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the combined pose; raises InputError on an invalid transform or covariance."""
        first = UncertainTransform(inputs.first, inputs.first_covariance)
        second = UncertainTransform(inputs.second, inputs.second_covariance)
        C1 = inputs.first_covariance + _LEAST_VARIANCE * np.eye(6)
        C2 = inputs.second_covariance + _LEAST_VARIANCE * np.eye(6)
        w = intersection_weight(C1, C2)
        information = w * np.linalg.inv(C1), (1.0 - w) * np.linalg.inv(C2)
        covariance = np.linalg.inv(information[0] + information[1])
        step = covariance @ information[1] @ pose_error(second.matrix, first.matrix)
        T = se3.transform(se3.exp_so3(step[3:]) @ first.matrix[:3, :3], first.matrix[:3, 3] + step[:3])
        return Outputs(pose=T, covariance=0.5 * (covariance + covariance.T), weight=w)


def intersection_weight(C1: FloatArray, C2: FloatArray) -> float:
    """Return the weight of the first in [0, 1]; both (6, 6) and positive definite."""
    L = np.linalg.cholesky(C1)
    half = np.linalg.solve(L, C2)
    # Information of the second along the six directions, where that of the first is 1.
    ratio = 1.0 / np.linalg.eigvalsh(np.linalg.solve(L, half.T))

    def slope(w: float) -> float:
        return float(np.sum((1.0 - ratio) / (w + (1.0 - w) * ratio)))

    if slope(1.0) >= 0.0:
        return 1.0
    if slope(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)

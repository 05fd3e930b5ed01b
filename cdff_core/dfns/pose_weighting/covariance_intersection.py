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

#: Added to all variances, so that singular covariances can be inverted.
_MIN_VARIANCE = 1e-14
#: Number of steps of the bisection for the weight.
_BISECTIONS = 40


class CovarianceIntersection(Interface[DfnConfig]):
    """Combine two poses with ``C^-1 = w C1^-1 + (1 - w) C2^-1``, where w minimises the determinant of C.

    Notes
    -----
    Julier and Uhlmann (1997), doi:10.1109/ACC.1997.609105: C is an upper bound for any correlation of the two
    errors. The weight of the smallest determinant does not depend on the units of translation and rotation.
    In coordinates in which C1 is the identity and C2 diagonal, the derivative of log det C^-1 with respect to
    w is a sum of six decreasing terms; its root is found by bisection.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the combined pose; raises InputError on an invalid transform or covariance."""
        first = UncertainTransform(inputs.first, inputs.first_covariance)
        second = UncertainTransform(inputs.second, inputs.second_covariance)
        C1 = inputs.first_covariance + _MIN_VARIANCE * np.eye(6)
        C2 = inputs.second_covariance + _MIN_VARIANCE * np.eye(6)
        w = _intersection_weight(C1, C2)
        first_information, second_information = w * np.linalg.inv(C1), (1.0 - w) * np.linalg.inv(C2)
        covariance = np.linalg.inv(first_information + second_information)
        step = covariance @ second_information @ pose_error(second.matrix, first.matrix)
        T = se3.transform(se3.exp_so3(step[3:]) @ first.matrix[:3, :3], first.matrix[:3, 3] + step[:3])
        return Outputs(pose=T, covariance=0.5 * (covariance + covariance.T), weight=w)


def _intersection_weight(C1: FloatArray, C2: FloatArray) -> float:
    """Return the weight of the first estimate in [0, 1], for positive definite covariances (6, 6)."""
    L = np.linalg.cholesky(C1)
    L_inv_C2 = np.linalg.solve(L, C2)
    # Information of the second estimate along the six common directions, relative to that of the first.
    ratio = 1.0 / np.linalg.eigvalsh(np.linalg.solve(L, L_inv_C2.T))

    def slope(w: float) -> float:
        """Return the derivative of the logarithm of the determinant of the information."""
        return float(np.sum((1.0 - ratio) / (w + (1.0 - w) * ratio)))

    if slope(1.0) >= 0.0:
        return 1.0
    if slope(0.0) <= 0.0:
        return 0.0
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if slope(middle) > 0.0 else (low, middle)
    return 0.5 * (low + high)

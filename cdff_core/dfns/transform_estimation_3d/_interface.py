# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN TransformEstimation3D."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class TransformEstimation3DInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points in the source frame, metres.
    sink : ndarray of float64, shape (n,3)
        Their partners in the sink frame, metres.
    sigmas : ndarray of float64, shape (n), optional
        Standard deviation of each pair's distance in one direction, metres; equal where absent.
    """

    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    sigmas: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class TransformEstimation3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_sink_source, metres.
    covariance : ndarray of float64, shape (6,6)
        [x y z rx ry rz], perturbation in the sink frame, formal: from the residuals of the pairs that agree.
    inliers : ndarray of bool, shape (n)
        Pairs that agree; all of them for LeastSquares.
    residuals : ndarray of float64, shape (n)
        Distance of each moved point from its partner, metres.
    unit_variance : ndarray of float64, shape ()
        Variance of unit weight of the pairs that agree; square metres where no sigmas are given.
    """

    transform: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    unit_variance: NDArray[np.float64]


class TransformEstimation3DInterface(Dfn[Any, TransformEstimation3DInputs, TransformEstimation3DOutputs]):
    """Find the rotation and translation that lay points in space upon their partners, with covariance."""

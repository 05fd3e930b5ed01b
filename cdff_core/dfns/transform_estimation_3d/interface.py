# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN TransformEstimation3D."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TransformEstimation3DInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,3)
        Points in the source frame, metres.
    sink : ndarray of float64, shape (n,3)
        Matching points in the sink frame, metres.
    sigmas : ndarray of float64, shape (n), optional
        Standard deviation of the difference of each pair along one axis, metres; default: equal for all
        pairs.
    """

    ARRAYS = ArrayPorts(
        {"source": "float64[n,3]", "sink": "float64[n,3]", "sigmas": "float64[n]"},
        finite=["source", "sink"],
        positive=["sigmas"],
        optional=["sigmas"],
    )

    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    sigmas: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class TransformEstimation3DOutputs:
    """Outputs of one call.

    Attributes
    ----------
    transform : ndarray of float64, shape (4,4)
        T_sink_source, metres.
    covariance : ndarray of float64, shape (6,6)
        Covariance of the transform, [x y z rx ry rz], perturbation in the sink frame; formal, from the
        residuals of the inliers.
    inliers : ndarray of bool, shape (n)
        True for the pairs used; all pairs for LeastSquares.
    residuals : ndarray of float64, shape (n)
        Distance of each transformed point from its match, metres.
    unit_variance : float
        Variance of unit weight of the inliers; square metres if no sigmas are given.
    """

    transform: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    unit_variance: float


class TransformEstimation3DInterface(Dfn[ConfigT, TransformEstimation3DInputs, TransformEstimation3DOutputs]):
    """Estimate the rotation and translation between matched points in space, with covariance."""


#: Short names for the implementations.
Inputs = TransformEstimation3DInputs
Outputs = TransformEstimation3DOutputs
Interface = TransformEstimation3DInterface

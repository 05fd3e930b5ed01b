# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN FundamentalMatrixComputation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FundamentalMatrixComputationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,2)
        Points of the first image, column and row, pixels, without distortion.
    sink : ndarray of float64, shape (n,2)
        Matching points of the second image, pixels, without distortion; some pairs are outliers.
    guess : ndarray of float64, shape (3,3), optional
        F near the solution, the start of the least squares; without it, random samples are drawn.
    """

    ARRAYS = ArrayPorts(
        {"source": "float64[n,2]", "sink": "float64[n,2]", "guess": "float64[3,3]"},
        finite=["source", "sink", "guess"],
        optional=["guess"],
    )

    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    guess: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class FundamentalMatrixComputationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    fundamental_matrix : ndarray of float64, shape (3,3)
        F of unit norm and rank 2: sink' F source = 0.
    covariance : ndarray of float64, shape (9,9)
        Covariance of the matrix read row by row, formal: sandwich estimator over the inliers with their
        leverage, enlarged for outliers within the gate; its rank is the number of parameters, 7.
    inliers : ndarray of bool, shape (n)
        Pairs that agree with the model.
    residuals : ndarray of float64, shape (n)
        Sampson distance of each pair, signed, pixels.
    sigma_px : float
        Standard deviation of an inlier's residual in one direction, pixels.
    log_false_alarms : float
        Log10 of the expected number of models with at least this support among random pairs.
    """

    fundamental_matrix: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    sigma_px: float
    log_false_alarms: float


class FundamentalMatrixComputationInterface(
    Dfn[ConfigT, FundamentalMatrixComputationInputs, FundamentalMatrixComputationOutputs]
):
    """Estimate the epipolar geometry of two images from pairs of points that include outliers."""


#: Short names for the implementations.
Inputs = FundamentalMatrixComputationInputs
Outputs = FundamentalMatrixComputationOutputs
Interface = FundamentalMatrixComputationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN EssentialMatrixComputation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EssentialMatrixComputationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,2)
        Points of the first image, column and row, pixels, without distortion.
    sink : ndarray of float64, shape (n,2)
        Matching points of the second image, pixels, without distortion; some pairs are outliers.
    source_camera : ndarray of float64, shape (3,3)
        Camera matrix of the first camera, pixels.
    sink_camera : ndarray of float64, shape (3,3), optional
        Camera matrix of the second camera; default: that of the first camera.
    """

    ARRAYS = ArrayPorts(
        {
            "source": "float64[n,2]",
            "sink": "float64[n,2]",
            "source_camera": "float64[3,3]",
            "sink_camera": "float64[3,3]",
        },
        finite=["source", "sink"],
        optional=["sink_camera"],
    )

    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    source_camera: NDArray[np.float64]
    sink_camera: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class EssentialMatrixComputationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    essential_matrix : ndarray of float64, shape (3,3)
        E = [t]x R with t of length 1, x_sink = R x_source + t.
    covariance : ndarray of float64, shape (9,9)
        Covariance of the matrix read row by row, formal: sandwich estimator over the inliers with their
        leverage, enlarged for outliers within the gate, and errors of the cameras; its rank is the number
        of parameters, 5.
    inliers : ndarray of bool, shape (n)
        Pairs that agree with the model.
    residuals : ndarray of float64, shape (n)
        Sampson distance of each pair, signed, pixels.
    sigma_px : float
        Standard deviation of an inlier's residual in one direction, pixels.
    ambiguity : float
        Sum of squared residuals, divided by that of the next best, different pose with the points in front
        of both cameras; 0 if there is no other pose, 1 if both are equally good.
    log_false_alarms : float
        Log10 of the expected number of models with at least this support among random pairs.
    """

    essential_matrix: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    sigma_px: float
    ambiguity: float
    log_false_alarms: float


class EssentialMatrixComputationInterface(
    Dfn[ConfigT, EssentialMatrixComputationInputs, EssentialMatrixComputationOutputs]
):
    """Estimate the epipolar geometry of two calibrated cameras from pairs of points that include
    outliers.
    """


#: Short names for the implementations.
Inputs = EssentialMatrixComputationInputs
Outputs = EssentialMatrixComputationOutputs
Interface = EssentialMatrixComputationInterface

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN EssentialMatrixComputation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class EssentialMatrixComputationInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,2)
        Points of the first image, column and row, pixels, without distortion.
    sink : ndarray of float64, shape (n,2)
        Their partners in the second image, some of them wrong.
    source_camera : ndarray of float64, shape (3,3)
        Matrix of the first camera, pixels.
    sink_camera : ndarray of float64, shape (3,3), optional
        Matrix of the second camera; the first where absent.
    """

    source: NDArray[np.float64]
    sink: NDArray[np.float64]
    source_camera: NDArray[np.float64]
    sink_camera: NDArray[np.float64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class EssentialMatrixComputationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    essential_matrix : ndarray of float64, shape (3,3)
        E = [t]x R with t of length 1, x_sink = R x_source + t.
    covariance : ndarray of float64, shape (9,9)
        Of the matrix read row by row, calibrated: sandwich over the inliers with their leverage, enlarged for wrong
        pairs within the gate; its rank is the number of parameters, 5.
    inliers : ndarray of bool, shape (n)
        Pairs that agree with the model.
    residuals : ndarray of float64, shape (n)
        Sampson distance of each pair, signed, pixels.
    sigma_px : ndarray of float64, shape ()
        Standard deviation of an inlier's residual in one direction, pixels.
    log_false_alarms : ndarray of float64, shape ()
        Log10 of how many such models chance would bring among random pairs.
    """

    essential_matrix: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    sigma_px: NDArray[np.float64]
    log_false_alarms: NDArray[np.float64]


class EssentialMatrixComputationInterface(
    Dfn[Any, EssentialMatrixComputationInputs, EssentialMatrixComputationOutputs]
):
    """Find the epipolar geometry of two calibrated cameras from pairs of points, some of them wrong."""

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN HomographyComputation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn


@dataclass(frozen=True, slots=True, eq=False)
class HomographyComputationInputs:
    """Inputs of one call.

    Attributes
    ----------
    source : ndarray of float64, shape (n,2)
        Points of the first image, column and row, pixels, without distortion.
    sink : ndarray of float64, shape (n,2)
        Their partners in the second image, some of them wrong.
    """

    source: NDArray[np.float64]
    sink: NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class HomographyComputationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    homography : ndarray of float64, shape (3,3)
        H of unit norm: sink ~ H source.
    covariance : ndarray of float64, shape (9,9)
        Of the matrix read row by row, calibrated: sandwich over the inliers with their leverage; its rank is the
        number of parameters, 8.
    inliers : ndarray of bool, shape (n)
        Pairs that agree with the model.
    residuals : ndarray of float64, shape (n)
        Distance of each pair from the map, pixels.
    sigma_px : ndarray of float64, shape ()
        Standard deviation of an inlier's residual in one direction, pixels.
    log_false_alarms : ndarray of float64, shape ()
        Log10 of how many such models chance would bring among random pairs.
    """

    homography: NDArray[np.float64]
    covariance: NDArray[np.float64]
    inliers: NDArray[np.bool_]
    residuals: NDArray[np.float64]
    sigma_px: NDArray[np.float64]
    log_false_alarms: NDArray[np.float64]


class HomographyComputationInterface(Dfn[Any, HomographyComputationInputs, HomographyComputationOutputs]):
    """Find the map between two images of a plane, or of anything from one place, from pairs of points, some of them
    wrong.
    """

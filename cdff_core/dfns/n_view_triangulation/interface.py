# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN NViewTriangulation."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import BundleProblem


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NViewTriangulationInputs:
    """Inputs of one call.

    Attributes
    ----------
    tracks : BundleProblem
        Cameras and observations of points; the positions of the points are ignored.
    """

    tracks: BundleProblem


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class NViewTriangulationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Positions in the frame of the poses, metres; NaN if undefined.
    covariances : ndarray of float64, shape (n,3,3)
        Formal covariance, square metres: sigma_px^2 (J'J)^-1, multiplied by unitVariance if unitVariance is
        above 1.
    valid : ndarray of bool, shape (n)
        True for points with status 0.
    status : ndarray of uint8, shape (n)
        0 valid, 1 fewer than two views, 2 degenerate, 3 behind a camera, 4 angle too small, 5 residual too
        large.
    angles : ndarray of float64, shape (n)
        Widest angle between two rays, radians.
    rms_px : ndarray of float64, shape (n)
        Root mean square reprojection error, pixels.
    unit_variance : float
        Variance of unit weight over all valid points: 1 if the residuals agree with sigma_px.
    """

    points: NDArray[np.float64]
    covariances: NDArray[np.float64]
    valid: NDArray[np.bool_]
    status: NDArray[np.uint8]
    angles: NDArray[np.float64]
    rms_px: NDArray[np.float64]
    unit_variance: float


class NViewTriangulationInterface(Dfn[ConfigT, NViewTriangulationInputs, NViewTriangulationOutputs]):
    """Triangulate points, with covariance, from their observations in two or more images with known
    poses.
    """


#: Short names for the implementations.
Inputs = NViewTriangulationInputs
Outputs = NViewTriangulationOutputs
Interface = NViewTriangulationInterface

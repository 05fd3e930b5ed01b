# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN NViewTriangulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import BundleProblem


@dataclass(frozen=True, slots=True, eq=False)
class NViewTriangulationInputs:
    """Inputs of one call.

    Attributes
    ----------
    tracks : BundleProblem
        Cameras and what each saw of which point; the points' own positions are not looked at.
    """

    tracks: BundleProblem


@dataclass(frozen=True, slots=True, eq=False)
class NViewTriangulationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    points : ndarray of float64, shape (n,3)
        Metres, in the frame of the poses; NaN where there is no answer at all.
    covariances : ndarray of float64, shape (n,3,3)
        Formal, square metres: sigma_px2 (J'J)^-1, enlarged where the residuals say so.
    valid : ndarray of bool, shape (n)
        Points that passed every gate.
    status : ndarray of uint8, shape (n)
        0 found, 1 fewer than two views, 2 degenerate, 3 behind a camera, 4 angle too small, 5 residual too large.
    angles : ndarray of float64, shape (n)
        Widest angle between two rays, radians.
    rms_px : ndarray of float64, shape (n)
        Root mean square distance from the observations, pixels.
    unit_variance : ndarray of float64, shape ()
        Variance of unit weight over all valid points: 1 where residuals are as sigma_px says.
    """

    points: NDArray[np.float64]
    covariances: NDArray[np.float64]
    valid: NDArray[np.bool_]
    status: NDArray[np.uint8]
    angles: NDArray[np.float64]
    rms_px: NDArray[np.float64]
    unit_variance: NDArray[np.float64]


class NViewTriangulationInterface(Dfn[Any, NViewTriangulationInputs, NViewTriangulationOutputs]):
    """Points in space from where they appear in two or more images taken at known poses, with their covariance."""

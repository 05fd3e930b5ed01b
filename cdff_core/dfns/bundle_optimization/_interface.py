# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN BundleOptimization."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import BundleProblem


@dataclass(frozen=True, slots=True, eq=False)
class BundleOptimizationInputs:
    """Inputs of one call.

    Attributes
    ----------
    problem : BundleProblem
        Cameras, lenses, points, observations and what is known beforehand.
    dropped : ndarray of int64, shape (k), optional
        Ids of cameras to be marginalised after the adjustment.
    """

    problem: BundleProblem
    dropped: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, eq=False)
class BundleOptimizationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    problem : BundleProblem
        The same problem with the poses, points and lenses that were found.
    pose_covariances : ndarray of float64, shape (n,6,6)
        Formal, x y z rx ry rz, perturbation in the frame, relative to the gauge: 0 what was held; NaN where there
        are none.
    point_covariances : ndarray of float64, shape (p,3,3)
        Formal, square metres, relative to the gauge; 0 of fixed points, NaN where there are none.
    residuals : ndarray of float64, shape (m,3)
        Predicted minus observed column, row and right column, pixels; the last 0 for a single image.
    weights : ndarray of float64, shape (m)
        Weight of each observation at the end under the robust loss.
    gauge : ndarray of int64, shape (g)
        Ids of the cameras that state the gauge: the first keeps of its pose what is free, the second its distance
        from it; none where fixed cameras, fixed points and the prior hold everything.
    remaining : BundleProblem, optional
        The problem without the dropped cameras and the points that they saw, which have become a prior; absent
        where none was dropped.
    """

    problem: BundleProblem
    pose_covariances: NDArray[np.float64]
    point_covariances: NDArray[np.float64]
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]
    gauge: NDArray[np.int64]
    remaining: BundleProblem | None = None


class BundleOptimizationInterface(Dfn[Any, BundleOptimizationInputs, BundleOptimizationOutputs]):
    """Find the poses, points and, on request, lenses that agree best with where the points were seen, from one image
    or from rectified pairs; with covariances relative to a stated gauge, and cameras marginalised to a prior.
    """

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from dfn.yaml by cdff generate; do not edit.
"""Interface of the DFN BundleOptimization."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.array_ports import ArrayPorts, DfnInputs
from cdff_common.interfaces.dfn import ConfigT, Dfn
from cdff_common.types import BundleProblem


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BundleOptimizationInputs(DfnInputs):
    """Inputs of one call.

    Attributes
    ----------
    problem : BundleProblem
        Cameras, lenses, points, observations and optionally a prior.
    dropped : ndarray of int64, shape (k), optional
        Ids of cameras that are marginalised after the adjustment.
    """

    ARRAYS = ArrayPorts({"dropped": "int64[k]"}, optional=["dropped"])

    problem: BundleProblem
    dropped: NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class BundleOptimizationOutputs:
    """Outputs of one call.

    Attributes
    ----------
    problem : BundleProblem
        The problem with the estimated poses, points and lenses.
    pose_covariances : ndarray of float64, shape (n,6,6)
        Formal covariances, [x y z rx ry rz], error in the frame of the problem, relative to the gauge; 0
        for fixed components, NaN if undefined.
    point_covariances : ndarray of float64, shape (p,3,3)
        Formal covariances, square metres, relative to the gauge; 0 for fixed points, NaN if undefined.
    residuals : ndarray of float64, shape (m,3)
        Predicted minus observed column, row and right column, pixels; the last is 0 for a single image.
    weights : ndarray of float64, shape (m)
        Final weight of each observation under the robust loss.
    gauge : ndarray of int64, shape (g)
        Ids of the cameras that define the gauge: the unconstrained components of the pose of the first
        camera, and the distance of the second camera from the first, keep their initial values; empty if
        fixed cameras, fixed points and the prior constrain all motions.
    remaining : BundleProblem, optional
        The problem without the dropped cameras and the points that they observed; a prior replaces the
        removed observations; absent if no cameras are to be dropped.
    """

    problem: BundleProblem
    pose_covariances: NDArray[np.float64]
    point_covariances: NDArray[np.float64]
    residuals: NDArray[np.float64]
    weights: NDArray[np.float64]
    gauge: NDArray[np.int64]
    remaining: BundleProblem | None = None


class BundleOptimizationInterface(Dfn[ConfigT, BundleOptimizationInputs, BundleOptimizationOutputs]):
    """Estimate the poses, points and optionally lenses that minimise the reprojection errors of points
    in single images or rectified pairs, with covariances relative to a stated gauge and
    marginalisation of cameras to a prior.
    """


#: Short names for the implementations.
Inputs = BundleOptimizationInputs
Outputs = BundleOptimizationOutputs
Interface = BundleOptimizationInterface

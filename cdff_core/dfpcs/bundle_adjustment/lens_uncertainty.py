# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Effect of the uncertainty of fixed focal lengths on poses and points."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from cdff_common.geometry.covariance import pose_error
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_common.types import BundleProblem
from cdff_common.types.bundle_ext import FOCAL
from cdff_core.dfns.bundle_optimization.interface import BundleOptimizationInputs


def lens_covariances(
    adjust: Dfn[Any, Any, Any], adjusted: BundleProblem, focal_length_ratio: float
) -> tuple[FloatArray, FloatArray]:
    """Return the covariances of poses (n, 6, 6) and points (p, 3, 3) due to the error of fixed focal lengths.

    The adjusted problem is adjusted again with focal lengths that are longer by one standard deviation
    (relative, ``focal_length_ratio``); the covariances are the squares of the changes. Lenses that the
    adjustment estimates are not changed. The errors of several fixed lenses are treated as equal.
    """
    lenses = adjusted.lenses
    is_fixed = (np.asarray(lenses.free) & FOCAL) == 0
    poses, points = adjusted.cameras.matrices, adjusted.points.positions
    if focal_length_ratio == 0.0 or not is_fixed.any():
        return np.zeros((len(poses), 6, 6)), np.zeros((len(points), 3, 3))
    values = np.array(lenses.values, np.float64)
    values[is_fixed, :2] *= 1.0 + focal_length_ratio
    longer = replace(adjusted, lenses=replace(lenses, values=values))
    adjusted_problem: BundleProblem = adjust.process(BundleOptimizationInputs(problem=longer)).problem
    pose_change = np.array(
        [pose_error(a, b) for a, b in zip(poses, adjusted_problem.cameras.matrices, strict=True)]
    )
    point_change = np.asarray(adjusted_problem.points.positions - points)
    return (
        pose_change[:, :, None] * pose_change[:, None, :],
        point_change[:, :, None] * point_change[:, None, :],
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Focal length of a camera, estimated together with its pose from points of a map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.visual_map.pose_fit import linearised_directions

_ITERATIONS = 8


@dataclass(frozen=True, slots=True)
class FocalRatio:
    """Ratio of the estimated focal length to the stated one, with its formal standard deviation."""

    value: float
    sigma: float


def fit_focal_ratio(
    T_camera_map: FloatArray,
    points: FloatArray,
    covariances: FloatArray,
    directions: FloatArray,
    sigma: float,
    gate: float,
) -> FocalRatio | None:
    """Return the ratio of the focal lengths from a fit of pose and ratio, with Tukey's weights.

    The residual of a point is that of ``fit_pose`` with the measured direction divided by the ratio. The
    parameters are those of ``fit_pose``, which also gives the first estimate of the pose.

    Returns
    -------
    FocalRatio or None
        None if the points do not determine the ratio, as on a plane across the axis of the camera.
    """
    T, ratio = np.array(T_camera_map), 1.0
    for _ in range(_ITERATIONS):
        residuals, by_pose, W = linearised_directions(T, points, covariances, directions / ratio, sigma)
        J = np.concatenate([by_pose, (directions / ratio**2)[:, :, None]], axis=2)
        squares = np.einsum("ni,nij,nj->n", residuals, W, residuals)
        weights = np.maximum(1.0 - squares / gate**2, 0.0) ** 2
        JW = np.einsum("nia,nij,n->naj", J, W, weights)
        normal = np.einsum("naj,njb->ab", JW, J)
        if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e12:
            return None
        step = -np.linalg.solve(normal, np.einsum("naj,nj->a", JW, residuals))
        T, ratio = se3.exp_se3(step[:6]) @ T, ratio + float(step[6])
        if not 0.2 < ratio < 5.0:
            return None
    return FocalRatio(ratio, float(np.sqrt(np.linalg.inv(normal)[6, 6])))

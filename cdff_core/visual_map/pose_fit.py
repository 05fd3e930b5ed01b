# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pose of a camera, with covariance, from points with covariances and their directions in its image."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.geometry import se3

#: Gauss-Newton steps.
_ITERATIONS = 10
#: Factor on the gate in the first iteration; it is halved in each iteration, since the first estimate is
#: inaccurate.
_FIRST_GATE = 4.0
#: Step of the last iteration, metres and radians.
_CONVERGED = 1e-5


@dataclass(frozen=True, slots=True, eq=False)
class PoseFit:
    """Result of a fit.

    Attributes
    ----------
    T_camera_map : ndarray, shape (4, 4)
    covariance : ndarray, shape (6, 6)
        Of a perturbation of ``T_camera_map`` from the left: x y z rx ry rz, metres and radians.
    inliers : ndarray of bool, shape (n,)
    variance_factor : float
        Mean squared normalised residual of the inliers, 1 if the stated variances are right.
    """

    T_camera_map: FloatArray
    covariance: FloatArray
    inliers: BoolArray
    variance_factor: float


def fit_pose(
    T_camera_map: FloatArray,
    points: FloatArray,
    covariances: FloatArray,
    directions: FloatArray,
    sigma: float,
    gate: float,
) -> PoseFit:
    """Fit a pose by iterated least squares with Tukey's weights [1]_.

    The residual of a point has the covariance of its direction and of the projected position.

    Parameters
    ----------
    T_camera_map : ndarray, shape (4, 4)
        First estimate.
    points, covariances : ndarray, shapes (n, 3) and (n, 3, 3)
        Points in the map, metres.
    directions : ndarray, shape (n, 2)
        Measured x / z and y / z in the frame of the camera.
    sigma : float
        Standard deviation of a direction.
    gate : float
        Normalised residual beyond which a point has no weight.

    Raises
    ------
    RefusedError
        ``unconstrained`` if the points do not determine the pose.

    References
    ----------
    .. [1] P. Holland, R. Welsch, Robust Regression Using Iteratively Reweighted Least-Squares, 1977,
       doi:10.1080/03610927708827533
    """
    T = np.array(T_camera_map)
    for iteration in range(_ITERATIONS):
        limit = gate * max(1.0, _FIRST_GATE * 0.5**iteration)
        residuals, J, W = linearised_directions(T, points, covariances, directions, sigma)
        squares, weights, normal, step = robust_step(residuals, J, W, limit)
        T = se3.exp_se3(step) @ T
        if limit == gate and np.abs(step).max() < _CONVERGED:
            break
    inliers = weights > 0.0
    factor = float(np.mean(squares[inliers])) / 2.0 if inliers.any() else np.inf
    return PoseFit(T, np.asarray(np.linalg.inv(normal), np.float64), inliers, factor)


def robust_step(
    residuals: FloatArray, J: FloatArray, W: FloatArray, limit: float
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return squared residuals (n,), Tukey's weights (n,), normal matrix (k, k) and Gauss-Newton step (k,).

    Raises
    ------
    RefusedError
        ``unconstrained`` if the residuals (n, 2) with derivatives J (n, 2, k) do not determine the step.
    """
    squares = np.einsum("ni,nij,nj->n", residuals, W, residuals)
    weights = np.maximum(1.0 - squares / limit**2, 0.0) ** 2
    JW = np.einsum("nia,nij,n->naj", J, W, weights)
    normal = np.einsum("naj,njb->ab", JW, J)
    if not np.isfinite(normal).all() or np.linalg.cond(normal) > 1e12:
        raise RefusedError("the matched points do not determine a pose", ["unconstrained"])
    step = -np.linalg.solve(normal, np.einsum("naj,nj->a", JW, residuals))
    return squares, weights, normal, step


def linearised_directions(
    T: FloatArray, points: FloatArray, covariances: FloatArray, directions: FloatArray, sigma: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return residuals (n, 2), derivatives (n, 2, 6) with respect to a perturbation from the left, weights
    (n, 2, 2).
    """
    p = se3.transform_points(T, points)
    z = np.where(p[:, 2] > 1e-3, p[:, 2], np.inf)
    projected = p[:, :2] / z[:, None]
    by_point = np.zeros((len(p), 2, 3))
    by_point[:, 0, 0] = by_point[:, 1, 1] = 1.0 / z
    by_point[:, :, 2] = -projected / z[:, None]
    by_pose = np.zeros((len(p), 3, 6))
    by_pose[:, :, :3] = np.eye(3)
    by_pose[:, [0, 1, 2], [4, 5, 3]] = p[:, [2, 0, 1]]
    by_pose[:, [0, 1, 2], [5, 3, 4]] = -p[:, [1, 2, 0]]
    D = by_point @ T[:3, :3]
    noise = D @ covariances @ np.swapaxes(D, 1, 2) + sigma**2 * np.eye(2)
    return projected - directions, by_point @ by_pose, np.asarray(np.linalg.inv(noise), np.float64)

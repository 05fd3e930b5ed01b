# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Likelihood of poses of a mesh given a scan: distances along the rays, overlap and free space.

Each measured ray that meets the model costs its squared depth difference over the variance, up to a limit.
A ray that misses the model, and a direction in which the model should have been measured but was not, cost a
constant. The sum is -2 log of the likelihood of a mixture of Gaussian noise and outliers, up to a constant.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross
from cdff_core.object_models.rendering import draw
from cdff_core.object_models.scan_view import ScanView

#: Largest cost of a ray that meets the model, and cost of a ray that misses the model, or passes through it
#: without an echo.
LIMIT, MISS = 9.0, 6.75


class Likelihood(NamedTuple):
    """Costs of poses.

    Attributes
    ----------
    cost : ndarray, shape (k,)
        -2 log likelihood of each pose, up to a constant.
    rays : ndarray, shape (k, 4)
        Numbers of: rays that agree with the model, rays that meet it at another depth, rays that miss it,
        rays that would have met it in directions without a measurement.
    """

    cost: FloatArray
    rays: FloatArray


def likelihood(
    view: ScanView, vertices_m: FloatArray, triangles: IntArray, poses: FloatArray, sigma_m: float
) -> Likelihood:
    """Return the costs of poses ``T_view_model`` (k, 4, 4).

    Parameters
    ----------
    sigma_m : float
        Standard deviation of a measured range, with that of the model.
    """
    k = len(poses)
    cost, rays = np.empty(k), np.empty((k, 4))
    free = (1.0 / (view.window.fx * view.spacing)) ** 2
    _costs(np.ascontiguousarray(poses, np.float64), vertices_m, triangles, view, sigma_m, free, cost, rays)
    return Likelihood(cost, rays)


def range_residuals(
    view: ScanView, vertices_m: FloatArray, triangles: IntArray, T_view_model: FloatArray
) -> FloatArray:
    """Return measured minus rendered range (k,), metres, of the rays that meet the model at a pose (4, 4)."""
    residuals = np.empty(len(view.points_m))
    _residuals(np.ascontiguousarray(T_view_model, np.float64), vertices_m, triangles, view, residuals)
    return residuals[np.isfinite(residuals)]


@njit(cache=True)
def _residuals(
    T_view_model: FloatArray, vertices: FloatArray, triangles: IntArray, view: ScanView, residuals: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the difference of each measured depth from the drawn model; NaN where the model is not drawn."""
    inverse_depth = np.zeros((view.window.rows, view.window.columns))
    face = np.full((view.window.rows, view.window.columns), -1)
    scratch = np.empty((len(vertices), 3))
    draw(vertices, triangles, T_view_model, view.window, inverse_depth, face, scratch)
    for i in range(len(view.points_m)):
        residuals[i] = _residual(view, i, inverse_depth, face, scratch, triangles)


@njit(cache=True, inline="always")
def _residual(
    view: ScanView,
    i: int,
    inverse_depth: FloatArray,
    face: IntArray,
    scratch: FloatArray,
    triangles: IntArray,
) -> float:  # pragma: no cover - compiled
    """Return measured minus rendered range of a ray; NaN if it misses the model."""
    row, column = view.pixels[i, 0], view.pixels[i, 1]
    f = face[row, column]
    if f < 0:
        return np.nan
    depth = _depth_at(scratch, triangles[f], view.tangents[i], 1.0 / inverse_depth[row, column])
    slope = np.sqrt(1.0 + view.tangents[i, 0] ** 2 + view.tangents[i, 1] ** 2)
    residual: float = (view.points_m[i, 2] - depth) * slope
    return residual


@njit(cache=True)
def _costs(
    poses: FloatArray,
    vertices: FloatArray,
    triangles: IntArray,
    view: ScanView,
    sigma: float,
    free: float,
    cost: FloatArray,
    rays: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Write the cost of each pose, and its numbers of agreeing, disagreeing, missed and free-space rays."""
    rows, columns = view.window.rows, view.window.columns
    inverse_depth = np.empty((rows, columns))
    face = np.empty((rows, columns), np.int64)
    scratch = np.empty((len(vertices), 3))
    for k in range(len(poses)):
        inverse_depth[:] = 0.0
        face[:] = -1
        draw(vertices, triangles, poses[k], view.window, inverse_depth, face, scratch)
        total, agree, other, missed, in_free_space = 0.0, 0, 0, 0, 0
        for i in range(len(view.points_m)):
            r = _residual(view, i, inverse_depth, face, scratch, triangles) / sigma
            if np.isnan(r):
                total += MISS
                missed += 1
                continue
            if r * r < LIMIT:
                total += r * r
                agree += 1
            else:
                total += LIMIT
                other += 1
        for row in range(rows):
            for column in range(columns):
                if face[row, column] >= 0 and not view.hit[row, column]:
                    in_free_space += 1
        cost[k] = total + MISS * free * in_free_space
        rays[k, 0], rays[k, 1], rays[k, 2], rays[k, 3] = agree, other, missed, free * in_free_space


@njit(cache=True, inline="always")
def _depth_at(
    points: FloatArray, corners: IntArray, tangent: FloatArray, at_pixel: float
) -> float:  # pragma: no cover - compiled
    """Return the depth of the plane of a triangle along a ray.

    The ray is up to half a pixel away from the centre, for which the triangle is visible: a depth that
    differs by more than a tenth from that of the centre belongs to a face that is seen edge-on.
    """
    a, b, c = points[corners[0]], points[corners[1]], points[corners[2]]
    ux, uy, uz = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    vx, vy, vz = c[0] - a[0], c[1] - a[1], c[2] - a[2]
    nx, ny, nz = cross(ux, uy, uz, vx, vy, vz)
    along = nx * tangent[0] + ny * tangent[1] + nz
    if along == 0.0:
        return at_pixel
    depth = (nx * a[0] + ny * a[1] + nz * a[2]) / along
    return at_pixel if abs(depth - at_pixel) > 0.1 * at_pixel else float(depth)

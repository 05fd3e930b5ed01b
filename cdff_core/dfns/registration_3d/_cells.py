# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normal distributions of a cloud: mean and inverse covariance of the points in each cell of a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry.kdtree import KdTree, kd_tree
from cdff_common.geometry.plane_fits import eigen
from cdff_common.geometry.voxels import voxel_rows

#: Ratio of the middle to the largest variance below which points lie along a line (a lidar ring), not on a
#: surface.
_LINE_RATIO = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Normal distributions of the cells of a cloud that contain a surface.

    Attributes
    ----------
    tree : KdTree
        Search tree of the means; the rows of the other arrays have the order of the tree.
    information : ndarray, shape (m, 3, 3)
        Inverse covariances, 1 / m^2.
    normals : ndarray, shape (m, 3)
        Axes of least variance.
    """

    tree: KdTree
    information: FloatArray
    normals: FloatArray


def fit_cells(
    points_m: FloatArray, cell_m: float, min_points: int, min_variance_ratio: float
) -> Cells | None:
    """Return the distributions of the cells with at least ``min_points`` points on a surface; None if no cell
    has.

    Variances are no smaller than ``min_variance_ratio`` times the largest variance of the cell (Magnusson
    2009, The three-dimensional normal-distributions transform, section 6.1).
    """
    row, keys = voxel_rows(points_m, cell_m)
    means, information, normals, is_surface = _fit_distributions(
        points_m, row, len(keys), min_points, min_variance_ratio
    )
    if not np.any(is_surface):
        return None
    tree = kd_tree(means[is_surface])
    return Cells(tree, information[is_surface][tree.order], normals[is_surface][tree.order])


@njit(cache=True)
def _fit_distributions(
    points: FloatArray, row: IntArray, m: int, min_points: int, min_variance_ratio: float
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:  # pragma: no cover - compiled
    """Return means (m, 3), information (m, 3, 3) and normals (m, 3) of the ``m`` cells, and which cells are
    on a surface (m,); ``row`` is the cell of each point.
    """
    count, means, scatter = np.zeros(m), np.zeros((m, 3)), np.zeros((m, 3, 3))
    information, normals, is_surface = np.zeros((m, 3, 3)), np.zeros((m, 3)), np.zeros(m, np.bool_)
    for i in range(len(points)):
        j = row[i]
        count[j] += 1.0
        for c in range(3):
            means[j, c] += points[i, c]
    for j in range(m):
        for c in range(3):
            means[j, c] /= count[j]
    for i in range(len(points)):
        j = row[i]
        for a in range(3):
            for b in range(a + 1):
                scatter[j, a, b] += (points[i, a] - means[j, a]) * (points[i, b] - means[j, b])
    values, vectors = np.empty(3), np.empty((3, 3))
    for j in range(m):
        if count[j] < min_points:
            continue
        eigen(scatter[j] / count[j], values, vectors)
        is_surface[j] = values[1] > _LINE_RATIO * values[2]
        for c in range(3):
            normals[j, c] = vectors[c, 0]
            values[c] = max(values[c], min_variance_ratio * values[2])
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    information[j, a, b] += vectors[a, c] * vectors[b, c] / max(values[c], 1e-18)
    return means, information, normals, is_surface

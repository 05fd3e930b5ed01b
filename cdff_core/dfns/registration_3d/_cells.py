# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normal distributions of a cloud: mean and inverse covariance of the points of each cell of a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray
from cdff_common.geometry.kdtree import KdTree, kd_tree
from cdff_common.geometry.plane_fits import eigen
from cdff_common.geometry.voxels import voxel_rows

#: Ratio of the second to the first variance below which points lie along a line (a lidar ring), not a
#: surface.
_LINE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Cells:
    """Normal distributions.

    Attributes
    ----------
    tree : KdTree
        Search tree of the means; the other arrays have its order.
    information : ndarray, shape (m, 3, 3)
        Inverse covariances, 1 / m^2.
    normals : ndarray, shape (m, 3)
        Axes of least variance.
    """

    tree: KdTree
    information: FloatArray
    normals: FloatArray


def cells_of(points_m: FloatArray, cell_m: float, least: int, flattest: float) -> Cells | None:
    """Return the distributions of cells with at least ``least`` points that span a surface; None where there
    are none.

    Variances are no smaller than ``flattest`` times the largest of the cell (Magnusson 2009, The
    three-dimensional normal-distributions transform, section 6.1).
    """
    row, keys = voxel_rows(points_m, cell_m)
    means, information, normals, keep = _fitted(points_m, row, len(keys), least, flattest)
    if not np.any(keep):
        return None
    tree = kd_tree(means[keep])
    return Cells(tree, information[keep][tree.order], normals[keep][tree.order])


@njit(cache=True)
def _fitted(
    points: FloatArray, row: IntArray, m: int, least: int, flattest: float
) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:  # pragma: no cover - compiled
    count, means, scatter = np.zeros(m), np.zeros((m, 3)), np.zeros((m, 3, 3))
    information, normals, keep = np.zeros((m, 3, 3)), np.zeros((m, 3)), np.zeros(m, np.bool_)
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
        if count[j] < least:
            continue
        eigen(scatter[j] / count[j], values, vectors)
        keep[j] = values[1] > _LINE * values[2]
        for c in range(3):
            normals[j, c] = vectors[c, 0]
            values[c] = max(values[c], flattest * values[2])
        for a in range(3):
            for b in range(3):
                for c in range(3):
                    information[j, a, b] += vectors[a, c] * vectors[b, c] / max(values[c], 1e-18)
    return means, information, normals, keep

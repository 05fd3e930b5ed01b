# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Separate bodies in a scan, and its noise."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.kdtree import kd_tree, nearest, neighbours
from cdff_common.geometry.neighbours import radius_neighbours

#: Points closer than this belong to one body, in diameters of the model.
_LINK = 0.25
#: Smallest number of neighbours within the link of a point that is not an outlier.
_MIN_NEIGHBOURS = 3
#: Bodies with fewer points than this fraction of the points of the largest body are outliers.
_SMALL = 0.1
#: Largest number of points that are linked; each other point belongs to the body of the nearest linked
#: point.
_MAX_LINKED = 800
#: Number of neighbours that determine the plane at a point.
_PLANE_NEIGHBOURS = 8


def bodies(points_m: FloatArray, diameter_m: float) -> list[IntArray]:
    """Return the rows of each separate body in a scan (n, 3), the largest first, without outliers.

    Bodies are apart by more than a quarter of the diameter of the model.
    """
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    step = -(-len(points_m) // _MAX_LINKED)
    sampled_points = points_m[::step]
    start, index = radius_neighbours(sampled_points, sampled_points, _LINK * diameter_m)
    graph = csr_matrix(
        (np.ones(len(index), np.int8), index, start), shape=(len(sampled_points), len(sampled_points))
    )
    labels = connected_components(graph, directed=False)[1]
    is_isolated = np.diff(start) <= _MIN_NEIGHBOURS
    if step > 1:
        distance, row = nearest(kd_tree(sampled_points), points_m)
        labels, is_isolated = labels[row], is_isolated[row] | (distance > _LINK * diameter_m)
    rows = [np.flatnonzero((labels == label) & ~is_isolated) for label in range(labels.max() + 1)]
    largest = max((len(r) for r in rows), default=0)
    return sorted((r for r in rows if len(r) >= max(_SMALL * largest, 1)), key=len, reverse=True)


def range_noise(points_m: FloatArray) -> float:
    """Return a robust standard deviation of the ranges of a scan (n, 3), metres, from planes of neighbours.

    Edges make it too large if the scan has few points.
    """
    ranges = np.linalg.norm(points_m, axis=1)
    direction = points_m / ranges[:, None]
    count = min(_PLANE_NEIGHBOURS, len(points_m))
    if count < 5:
        return float(np.std(ranges))
    # Neighbours by direction: their ranges are a linear function of the direction, inverse range exactly.
    _, rows = neighbours(kd_tree(direction), direction, count)
    A = direction[rows]
    weight = ranges[rows]
    A = A * weight[..., None]
    b = np.ones((len(points_m), count))
    solution = np.einsum("nij,nj->ni", np.linalg.pinv(A, rcond=1e-6), b)
    # n . p = 1 on the plane: the distance along the ray is range (1 - n . p) / (n . p).
    residual = (b - np.einsum("nij,nj->ni", A, solution)) * weight
    variance = np.sum(residual**2, axis=1) / (count - 3)
    return float(np.sqrt(np.median(variance)))

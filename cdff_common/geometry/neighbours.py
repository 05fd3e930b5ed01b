# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Neighbours within a radius, as flat arrays for compiled loops."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.errors import InputError

Float = NDArray[np.float64]
Int = NDArray[np.int64]

#: Number of cells along a radius.
_CELLS = 3


def radius_neighbours(points_m: Float, queries_m: Float, radius_m: float) -> tuple[Int, Int]:
    """Return the points within a radius of each query.

    Parameters
    ----------
    points_m : ndarray, shape (n, 3)
        Finite, metres; n may be 0.
    queries_m : ndarray, shape (k, 3)
        Finite, metres.
    radius_m : float
        Above 0; a point at exactly this distance is a neighbour.

    Returns
    -------
    tuple of ndarray
        ``start`` (k + 1,) and ``index`` so that the neighbours of query i are ``index[start[i]:start[i +
        1]]``, in the order of their cells.

    Raises
    ------
    InputError
        If the radius is not above 0, or so small for the extent that the index of a cell does not fit 62
        bits.
    """
    if not radius_m > 0.0:
        raise InputError(f"radius_m={radius_m}: expected metres above 0")
    if not len(points_m):
        return np.zeros(len(queries_m) + 1, np.int64), np.zeros(0, np.int64)
    edge_m = radius_m / _CELLS
    low = points_m.min(axis=0) - radius_m
    size = np.floor((points_m.max(axis=0) - low) / edge_m) + 2.0
    if np.prod(size) >= 2.0**62:
        raise InputError(f"radius_m={radius_m}: too small for a cloud of {np.ptp(points_m, axis=0)} m")
    cells = np.floor((points_m - low) / edge_m).astype(np.int64)
    ny, nz = int(size[1]), int(size[2])
    key = (cells[:, 0] * ny + cells[:, 1]) * nz + cells[:, 2]
    order = np.argsort(key, kind="stable")
    return _search(points_m[order], key[order], order, queries_m, low, size.astype(np.int64), radius_m)


@njit(cache=True)
def _search(
    points: Float, key: Int, order: Int, queries: Float, low: Float, size: Int, radius: float
) -> tuple[Int, Int]:  # pragma: no cover - compiled
    """Visit the columns of cells that intersect the sphere; consecutive cells along z are adjacent in
    memory.
    """
    edge = radius / _CELLS
    start = np.zeros(len(queries) + 1, np.int64)
    index = np.empty(64 * len(queries) + 64, np.int64)
    total = 0
    for i in range(len(queries)):
        x, y, z = queries[i, 0], queries[i, 1], queries[i, 2]
        cx = math.floor((x - low[0]) / edge)
        cy = math.floor((y - low[1]) / edge)
        cz = math.floor((z - low[2]) / edge)
        first_z, last_z = max(cz - _CELLS, 0), min(cz + _CELLS, size[2] - 1)
        for gx in range(max(cx - _CELLS, 0), min(cx + _CELLS + 1, size[0])):
            edge_low = low[0] + gx * edge
            off_x = max(edge_low - x, x - edge_low - edge, 0.0)
            for gy in range(max(cy - _CELLS, 0), min(cy + _CELLS + 1, size[1])):
                edge_low = low[1] + gy * edge
                off_y = max(edge_low - y, y - edge_low - edge, 0.0)
                # Slightly more than the radius, since cell edges are rounded.
                if first_z > last_z or off_x * off_x + off_y * off_y > 1.000001 * radius * radius:
                    continue
                column_key = (gx * size[1] + gy) * size[2]
                low_j = np.searchsorted(key, column_key + first_z)
                high_j = low_j
                while high_j < len(key) and key[high_j] <= column_key + last_z:
                    high_j += 1
                if total + high_j - low_j > len(index):
                    larger = np.empty(2 * len(index) + high_j - low_j, np.int64)
                    larger[:total] = index[:total]
                    index = larger
                for j in range(low_j, high_j):
                    dx, dy, dz = points[j, 0] - x, points[j, 1] - y, points[j, 2] - z
                    # Written always, counted if within the radius: a branch would be mispredicted half of the
                    # time.
                    index[total] = order[j]
                    total += dx * dx + dy * dy + dz * dz <= radius * radius
        start[i + 1] = total
    return start, index[:total].copy()

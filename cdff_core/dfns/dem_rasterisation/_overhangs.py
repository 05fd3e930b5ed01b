# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Separation of overhanging structure from the ground below it, cell by cell."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray, IntArray

#: Steepest ground, as a tangent (60°): a gap on ground is at most this times its horizontal length.
_STEEPEST_GROUND = float(np.tan(np.radians(60.0)))
#: Steps lower than this fraction of the edge of a cell are relief of the ground.
_RELIEF_RATIO = 0.5


def find_overhangs(cell: IntArray, points_m: FloatArray, gap_m: float, edge_m: float) -> BoolArray:
    """Return which points lie above the lowest empty space in their cell.

    An empty space is a vertical gap of at least ``gap_m`` and at least half of the edge of a cell. On steep
    ground, the heights of scattered points have such gaps too. The horizontal distance between the points
    below and above a gap distinguishes them, as in the slope-based filter of Vosselman (2000), ISPRS Archives
    33(B3): the gap must be steeper than ground of 60° over the smallest distance.

    Parameters
    ----------
    cell : ndarray of int64, shape (n,)
        Cell of each point; -1 is ignored.
    points_m : ndarray, shape (n, 3)
        Points, z up, metres.
    gap_m : float
        Smallest height of an empty space, metres.
    edge_m : float
        Edge of a cell, metres.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    gap_m = max(gap_m, _RELIEF_RATIO * edge_m)
    order, levels = _levels(cell, points_m[:, 2], gap_m)
    is_overhang = np.zeros(len(cell), dtype=np.bool_)
    if gap_m >= _STEEPEST_GROUND * np.sqrt(2.0) * edge_m:
        # No two points of a cell are far enough apart for a gap on ground.
        is_overhang[order] = levels > 0
        return is_overhang
    cells, z_m = np.unique(cell[order], return_inverse=True)[1], points_m[order, 2]
    undecided = np.ones(int(cells.max(initial=-1)) + 1, dtype=np.bool_)
    for level in range(1, int(levels.max(initial=0)) + 1):
        undecided &= np.bincount(cells, levels == level, len(undecided)) > 0
        above, below = undecided[cells] & (levels >= level), undecided[cells] & (levels < level)
        distance_m = _horizontal_distance(cells, points_m[order, :2], below, above, edge_m)
        low, high = np.full((2, len(undecided)), [[-np.inf], [np.inf]])
        np.maximum.at(low, cells[below], z_m[below])
        np.minimum.at(high, cells[above], z_m[above])
        found = undecided & (high - low > _STEEPEST_GROUND * distance_m)
        is_overhang[order] |= above & found[cells]
        undecided &= ~found
    return is_overhang


def _levels(cell: IntArray, z_m: FloatArray, gap_m: float) -> tuple[IntArray, IntArray]:
    """Return the points of cells with gaps by cell and height, and the number of gaps below each of them."""
    cells = int(cell.max(initial=0)) + 1
    low, high = np.full((2, cells), [[np.inf], [-np.inf]])
    use = cell >= 0
    np.minimum.at(low, cell[use], z_m[use])
    np.maximum.at(high, cell[use], z_m[use])
    # Empty cells have a negative extent.
    tall = np.flatnonzero(use & ((high - low)[cell] >= gap_m))
    order = tall[np.lexsort((z_m[tall], cell[tall]))]
    c, z = cell[order], z_m[order]
    is_first = np.append(True, c[1:] != c[:-1])[: len(c)]
    gaps = np.cumsum(np.append(False, (z[1:] - z[:-1] >= gap_m) & ~is_first[1:])[: len(c)])
    first = np.maximum.accumulate(np.where(is_first, np.arange(len(c)), 0))
    return order, gaps - gaps[first]


def _horizontal_distance(
    cells: IntArray, xy_m: FloatArray, below: BoolArray, above: BoolArray, edge_m: float
) -> FloatArray:
    """Return the smallest horizontal distance between points below and above in each cell, else infinity."""
    from cdff_common.geometry.kdtree import kd_tree, nearest

    distance_m = np.full(int(cells.max(initial=-1)) + 1, np.inf)
    if below.any():
        # With cells 2 edges apart along a third axis, the nearest point is one of the same cell.
        separated = np.c_[xy_m - xy_m.min(axis=0), 2.0 * edge_m * cells]
        found_m, _ = nearest(kd_tree(separated[below]), separated[above])
        np.minimum.at(distance_m, cells[above], found_m)
    return distance_m

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
        has_overhang = undecided & (high - low > _STEEPEST_GROUND * distance_m)
        is_overhang[order] |= above & has_overhang[cells]
        undecided &= ~has_overhang
    return is_overhang


def find_overhanging_structure(
    cell: IntArray, points_m: FloatArray, is_structure: BoolArray, gap_m: float, edge_m: float
) -> BoolArray:
    """Return which points of structure overhang the ground in their cell.

    A cell is divided if one of its points of structure is at least ``gap_m`` above the nearest point of the
    ground in this cell, and steeper than ground of 60°. This rejects steep ground that a filter has
    classified as structure. A cell without ground remains as it is.

    Parameters
    ----------
    cell : ndarray of int64, shape (n,)
        Cell of each point; -1 is ignored.
    points_m : ndarray, shape (n, 3)
        Points, z up, metres.
    is_structure : ndarray of bool, shape (n,)
        Points that a ground filter has classified as structure.
    gap_m : float
        Smallest height above the ground, metres.
    edge_m : float
        Edge of a cell, metres.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    cells = int(cell.max(initial=-1)) + 1
    has_ground = np.bincount(cell[(cell >= 0) & ~is_structure], minlength=cells) > 0
    is_candidate = (cell >= 0) & is_structure
    is_candidate[is_candidate] = has_ground[cell[is_candidate]]
    has_candidate = np.bincount(cell[is_candidate], minlength=cells) > 0
    is_ground = (cell >= 0) & ~is_structure
    is_ground[is_ground] = has_candidate[cell[is_ground]]
    if not is_candidate.any():
        return is_candidate
    above, ground = points_m[is_candidate], points_m[is_ground]
    distance_m, index = _nearest_in_cell(
        above[:, :2], cell[is_candidate], ground[:, :2], cell[is_ground], edge_m
    )
    height_m = above[:, 2] - ground[index, 2]
    is_step = (height_m >= gap_m) & (height_m > _STEEPEST_GROUND * distance_m)
    is_divided = np.bincount(cell[is_candidate][is_step], minlength=cells) > 0
    is_candidate[is_candidate] = is_divided[cell[is_candidate]]
    return is_candidate


def _levels(cell: IntArray, z_m: FloatArray, gap_m: float) -> tuple[IntArray, IntArray]:
    """Return the points of cells with gaps, sorted by cell and height, and the number of gaps below each
    point.
    """
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
    distance_m = np.full(int(cells.max(initial=-1)) + 1, np.inf)
    if below.any():
        found_m, _ = _nearest_in_cell(xy_m[above], cells[above], xy_m[below], cells[below], edge_m)
        np.minimum.at(distance_m, cells[above], found_m)
    return distance_m


def _nearest_in_cell(
    xy_m: FloatArray, cells: IntArray, other_xy_m: FloatArray, other_cells: IntArray, edge_m: float
) -> tuple[FloatArray, IntArray]:
    """Return the horizontal distance to, and the row of, the nearest other point, which is in the same cell.

    With cells 2 edges apart along a third axis, the nearest point is one of the same cell, if there is one.
    """
    from cdff_common.geometry.kdtree import kd_tree, nearest

    origin = other_xy_m.min(axis=0)
    tree = kd_tree(np.c_[other_xy_m - origin, 2.0 * edge_m * other_cells])
    distance_m, index = nearest(tree, np.c_[xy_m - origin, 2.0 * edge_m * cells])
    return distance_m, index

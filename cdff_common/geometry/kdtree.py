# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Static kd-tree of 3-D points for use inside compiled loops."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]

#: Largest number of points of a leaf.
_LEAF = 10
#: Largest depth: 2^40 leaves.
_DEPTH = 40


class KdTree(NamedTuple):
    """Tree as arrays: inner nodes in heap order, points in the order of the leaves.

    Attributes
    ----------
    points : ndarray, shape (n, 3)
        Reordered points; those of leaf i are ``points[start[i]:start[i + 1]]``.
    order : ndarray of int64, shape (n,)
        Row in the original cloud of each reordered point.
    axis, split : ndarray, shape (2^d - 1,)
        Axis and value of inner node i, whose children are ``2 i + 1`` (below the split) and ``2 i + 2``.
    start : ndarray of int64, shape (2^d + 1,)
    """

    points: Float
    order: Int
    axis: Int
    split: Float
    start: Int


def kd_tree(points_m: Float) -> KdTree:
    """Build the tree of finite points ``(n, 3)``, n at least 1; deterministic.

    Bentley (1975), doi:10.1145/361002.361007: split at the median of the widest axis.
    """
    return _build(np.ascontiguousarray(points_m, dtype=np.float64))


def nearest(tree: KdTree, queries_m: Float, max_distance_m: float = np.inf) -> tuple[Float, Int]:
    """Return distance and row of the nearest point of each query ``(k, 3)``; infinity and -1 if too far."""
    return _nearest_all(tree, np.ascontiguousarray(queries_m, dtype=np.float64), max_distance_m)


def spacing(tree: KdTree, sample: int = 5000) -> float:
    """Return the median distance between nearest neighbours, of about ``sample`` points of the tree."""
    step = max(1, len(tree.points) // sample)
    distance, _ = neighbours(tree, tree.points[::step], 2)
    return max(float(np.median(distance[:, 1])), 1e-9)


def neighbours(tree: KdTree, queries_m: Float, count: int) -> tuple[Float, Int]:
    """Return distances and rows ``(k, count)`` of the nearest points, nearest first, padded by infinity and
    -1.
    """
    return _neighbours_all(tree, np.ascontiguousarray(queries_m, dtype=np.float64), count)


@njit(cache=True)
def _build(cloud: Float) -> KdTree:  # pragma: no cover - compiled
    """Return the tree of a cloud (n, 3); each inner node splits the widest axis at its median."""
    n = len(cloud)
    depth = 0
    while (n >> depth) > _LEAF:
        depth += 1
    inner = (1 << depth) - 1
    points, order = cloud.copy(), np.arange(n)
    axis, split = np.zeros(inner, np.int64), np.zeros(inner)
    low, high = np.zeros(2 * inner + 1, np.int64), np.zeros(2 * inner + 1, np.int64)
    high[0] = n
    for node in range(inner):
        a, b = low[node], high[node]
        widest, width = 0, -1.0
        for c in range(3):
            lowest, highest = points[a, c], points[a, c]
            for i in range(a + 1, b):
                lowest, highest = min(lowest, points[i, c]), max(highest, points[i, c])
            if highest - lowest > width:
                widest, width = c, highest - lowest
        middle = (a + b) // 2
        _select(points, order, a, b, middle, widest)
        axis[node], split[node] = widest, points[middle, widest]
        low[2 * node + 1], high[2 * node + 1] = a, middle
        low[2 * node + 2], high[2 * node + 2] = middle, b
    start = np.empty(inner + 2, np.int64)
    start[:-1] = low[inner:]
    start[-1] = n
    return KdTree(points, order, axis, split, start)


@njit(cache=True)
def _select(
    points: Float, order: Int, a: int, b: int, k: int, axis: int
) -> None:  # pragma: no cover - compiled
    """Reorder rows a to b so that row k has its sorted position along the axis (Hoare 1961)."""
    low, high = a, b - 1
    while low < high:
        first, middle, last = points[low, axis], points[(low + high) // 2, axis], points[high, axis]
        pivot = max(min(first, middle), min(max(first, middle), last))
        i, j = low, high
        while i <= j:
            while points[i, axis] < pivot:
                i += 1
            while points[j, axis] > pivot:
                j -= 1
            if i <= j:
                for c in range(3):
                    value = points[i, c]
                    points[i, c] = points[j, c]
                    points[j, c] = value
                row = order[i]
                order[i] = order[j]
                order[j] = row
                i += 1
                j -= 1
        if k <= j:
            high = j
        elif k >= i:
            low = i
        else:
            return


@njit(cache=True)
def _leaf_below(
    tree: KdTree,
    x: float,
    y: float,
    z: float,
    node: int,
    depth: int,
    d2: float,
    ox: float,
    oy: float,
    oz: float,
    worst: float,
    nodes: Int,
    bounds: Float,
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Descend from a node to the leaf of a point; push the other children nearer than ``worst`` on the stack.

    ``d2`` is the squared distance of the point from the node's box, ``ox, oy, oz`` its components, metres.
    Returns the leaf and the height of the stack (Arya and Mount 1993, doi:10.1109/DCC.1993.253111).
    """
    inner = len(tree.axis)
    while node < inner:
        c = tree.axis[node]
        if c == 0:
            off, previous_off = x - tree.split[node], ox
        elif c == 1:
            off, previous_off = y - tree.split[node], oy
        else:
            off, previous_off = z - tree.split[node], oz
        far = d2 - previous_off * previous_off + off * off
        if far < worst:
            bounds[depth, 0] = far
            bounds[depth, 1] = off if c == 0 else ox
            bounds[depth, 2] = off if c == 1 else oy
            bounds[depth, 3] = off if c == 2 else oz
            nodes[depth] = 2 * node + 2 if off < 0.0 else 2 * node + 1
            depth += 1
        node = 2 * node + 1 if off < 0.0 else 2 * node + 2
    return node - inner, depth


@njit(cache=True)
def nearest_row(
    tree: KdTree, x: float, y: float, z: float, best: int, best_d2: float, nodes: Int, bounds: Float
) -> tuple[int, float]:  # pragma: no cover - compiled
    """Return the reordered row nearest to a point if nearer than ``best_d2``, else ``best``; and its squared
    distance.

    Parameters
    ----------
    best, best_d2 : int, float
        Initial candidate: a row (or -1) and its squared distance.
    nodes, bounds : ndarray, shapes (40,) and (40, 4)
        Scratch, see ``scratch``.
    """
    node, depth = 0, 0
    d2 = ox = oy = oz = 0.0
    while True:
        leaf, depth = _leaf_below(tree, x, y, z, node, depth, d2, ox, oy, oz, best_d2, nodes, bounds)
        for i in range(tree.start[leaf], tree.start[leaf + 1]):
            dx, dy, dz = tree.points[i, 0] - x, tree.points[i, 1] - y, tree.points[i, 2] - z
            d = dx * dx + dy * dy + dz * dz
            if d < best_d2:
                best, best_d2 = i, d
        while depth > 0 and bounds[depth - 1, 0] >= best_d2:
            depth -= 1
        if depth == 0:
            return best, best_d2
        depth -= 1
        node = nodes[depth]
        d2, ox, oy, oz = bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3]


@njit(cache=True)
def nearest_two(
    tree: KdTree,
    x: float,
    y: float,
    z: float,
    row: int,
    row_d2: float,
    gate: float,
    nodes: Int,
    bounds: Float,
) -> tuple[int, float, float]:  # pragma: no cover - compiled
    """Return the reordered row nearest to a point, its squared distance, and a lower bound of the distance to
    all other points: that of the second nearest one, at most ``gate``.

    Parameters
    ----------
    row, row_d2 : int, float
        Initial candidate: a row (or -1) and its squared distance (or infinity).
    gate : float
        Distance beyond which points are not searched.
    nodes, bounds : ndarray, shapes (40,) and (40, 4)
        Scratch, see ``scratch``.
    """
    best, best_d2, second_d2 = row, row_d2, gate * gate
    node, depth = 0, 0
    d2 = ox = oy = oz = 0.0
    while True:
        leaf, depth = _leaf_below(tree, x, y, z, node, depth, d2, ox, oy, oz, second_d2, nodes, bounds)
        for i in range(tree.start[leaf], tree.start[leaf + 1]):
            dx, dy, dz = tree.points[i, 0] - x, tree.points[i, 1] - y, tree.points[i, 2] - z
            d = dx * dx + dy * dy + dz * dz
            if d < second_d2 and i != row:
                if d < best_d2:
                    second_d2 = min(best_d2, second_d2)
                    best, best_d2 = i, d
                else:
                    second_d2 = d
        while depth > 0 and bounds[depth - 1, 0] >= second_d2:
            depth -= 1
        if depth == 0:
            return best, best_d2, np.sqrt(second_d2)
        depth -= 1
        node = nodes[depth]
        d2, ox, oy, oz = bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3]


@njit(cache=True)
def nearest_rows(
    tree: KdTree, x: float, y: float, z: float, worst: float, rows: Int, d2s: Float, nodes: Int, bounds: Float
) -> int:  # pragma: no cover - compiled
    """Fill ``rows`` and ``d2s`` with the nearest reordered rows, nearest first, with squared distances below
    ``worst``; return their number.
    """
    count, found_count = len(rows), 0
    node, depth = 0, 0
    d2 = ox = oy = oz = 0.0
    while True:
        leaf, depth = _leaf_below(tree, x, y, z, node, depth, d2, ox, oy, oz, worst, nodes, bounds)
        for i in range(tree.start[leaf], tree.start[leaf + 1]):
            dx, dy, dz = tree.points[i, 0] - x, tree.points[i, 1] - y, tree.points[i, 2] - z
            d = dx * dx + dy * dy + dz * dz
            if d < worst:
                j = found_count if found_count < count else count - 1
                while j > 0 and d2s[j - 1] > d:
                    d2s[j], rows[j] = d2s[j - 1], rows[j - 1]
                    j -= 1
                d2s[j], rows[j] = d, i
                found_count = min(found_count + 1, count)
                if found_count == count:
                    worst = d2s[count - 1]
        while depth > 0 and bounds[depth - 1, 0] >= worst:
            depth -= 1
        if depth == 0:
            return found_count
        depth -= 1
        node = nodes[depth]
        d2, ox, oy, oz = bounds[depth, 0], bounds[depth, 1], bounds[depth, 2], bounds[depth, 3]


@njit(cache=True)
def scratch() -> tuple[Int, Float]:  # pragma: no cover - compiled
    """Return the stacks for ``nearest_row``, ``nearest_two`` and ``nearest_rows``, for many queries."""
    return np.empty(_DEPTH, np.int64), np.empty((_DEPTH, 4))


@njit(cache=True)
def _nearest_all(tree: KdTree, queries: Float, max_distance: float) -> tuple[Float, Int]:  # pragma: no cover
    """Return distance and row of the nearest point of each query; infinite and -1 beyond ``max_distance``."""
    distance, row = np.empty(len(queries)), np.empty(len(queries), np.int64)
    nodes, bounds = scratch()
    # A point at exactly the largest distance is included.
    limit = np.nextafter(max_distance * max_distance, np.inf)
    for i in range(len(queries)):
        j, d2 = nearest_row(tree, queries[i, 0], queries[i, 1], queries[i, 2], -1, limit, nodes, bounds)
        distance[i], row[i] = (np.inf, -1) if j < 0 else (np.sqrt(d2), tree.order[j])
    return distance, row


@njit(cache=True)
def _neighbours_all(
    tree: KdTree, queries: Float, count: int
) -> tuple[Float, Int]:  # pragma: no cover - compiled
    """Return distances and rows (n, count) of the nearest points of each query; -1 where there are fewer."""
    distance = np.full((len(queries), count), np.inf)
    row = np.full((len(queries), count), -1)
    nodes, bounds = scratch()
    rows, d2s = np.empty(count, np.int64), np.empty(count)
    for i in range(len(queries)):
        filled = nearest_rows(
            tree, queries[i, 0], queries[i, 1], queries[i, 2], np.inf, rows, d2s, nodes, bounds
        )
        for j in range(filled):
            distance[i, j], row[i, j] = np.sqrt(d2s[j]), tree.order[rows[j]]
    return distance, row

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of the registrations: pairs of nearest points, and their normal equations."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.kdtree import KdTree, nearest_two, scratch
from cdff_common.geometry.small_vectors import cross, transformed

#: Kernel numbers of ``weight_of`` by name.
KERNELS = {"none": 0, "tukey": 1, "huber": 2, "cauchy": 3, "geman_mcclure": 4}


class Pairs(NamedTuple):
    """Pairs of the source's points with points of the target, reused by the next iteration.

    Attributes
    ----------
    row : ndarray of int64, shape (n,)
        Row in the target's tree of the nearest point, or -1.
    moved : ndarray, shape (n, 3)
        The transformed source.
    bound_m : ndarray, shape (n,)
        Lower bound of the distance to all other points of the target.
    """

    row: IntArray
    moved: FloatArray
    bound_m: FloatArray


@njit(cache=True)
def no_pairs(count: int) -> Pairs:  # pragma: no cover - compiled
    """Return the pairs of ``count`` points before the first search."""
    return Pairs(np.full(count, -1), np.zeros((count, 3)), np.full(count, -np.inf))


@njit(cache=True)
def pair(
    tree: KdTree, source: FloatArray, T_target_source: FloatArray, gate: float, pairs: Pairs
) -> int:  # pragma: no cover
    """Transform the source, and pair each point with the nearest one of the target within a gate; return the
    number of pairs.

    A point that moved by s is at least ``bound_m - s`` from the points it was not paired with. It is searched
    again only if its pair is farther than that, so most searches of late iterations are omitted without a
    change of the result (Greenspan and Godin 2001, doi:10.1109/IM.2001.924426).

    Parameters
    ----------
    tree : KdTree
        Search tree of the target.
    source : ndarray, shape (n, 3)
    T_target_source : ndarray, shape (4, 4)
    gate : float
        Largest distance of a pair, metres.
    pairs : Pairs
        Pairs of the previous iteration, replaced by those of this one.
    """
    nodes, bounds = scratch()
    row, moved, bound_m = pairs
    count = 0
    for i in range(len(source)):
        x, y, z = transformed(T_target_source, source[i, 0], source[i, 1], source[i, 2])
        sx, sy, sz = x - moved[i, 0], y - moved[i, 1], z - moved[i, 2]
        moved[i, 0], moved[i, 1], moved[i, 2] = x, y, z
        others, j, d2 = bound_m[i] - np.sqrt(sx * sx + sy * sy + sz * sz), row[i], np.inf
        if j >= 0:
            dx, dy, dz = tree.points[j, 0] - x, tree.points[j, 1] - y, tree.points[j, 2] - z
            d2 = dx * dx + dy * dy + dz * dz
        if others < gate and not (others > 0.0 and d2 <= others * others):
            j, d2, others = nearest_two(tree, x, y, z, j, d2, gate, nodes, bounds)
        if d2 >= gate * gate:
            j, others = -1, min(others, np.sqrt(d2))
        row[i], bound_m[i] = j, others
        count += j >= 0
    return count


@njit(cache=True)
def plane_distances(
    points: FloatArray, normals: FloatArray, row: IntArray, moved: FloatArray
) -> FloatArray:  # pragma: no cover - compiled
    """Return the signed distances ``n . (p - q)`` of the paired points p from the planes at q, in the order
    of the source, metres.
    """
    out = np.empty(len(row))
    count = 0
    for i in range(len(row)):
        j = row[i]
        if j < 0:
            continue
        d = 0.0
        for c in range(3):
            d += (moved[i, c] - points[j, c]) * normals[j, c]
        out[count] = d
        count += 1
    return out[:count]


@njit(cache=True)
def centre_and_radius(
    row: IntArray, moved: FloatArray
) -> tuple[FloatArray, float]:  # pragma: no cover - compiled
    """Return the mean of the paired transformed points, and their RMS distance from it."""
    centre = np.zeros(3)
    count, square = 0, 0.0
    for i in range(len(row)):
        if row[i] >= 0:
            count += 1
            for c in range(3):
                centre[c] += moved[i, c]
    centre /= max(count, 1)
    for i in range(len(row)):
        if row[i] >= 0:
            for c in range(3):
                square += (moved[i, c] - centre[c]) ** 2
    return centre, max(np.sqrt(square / max(count, 1)), 1e-9)


@njit(cache=True, inline="always")
def weight_of(u: float, kernel: int) -> float:  # pragma: no cover - compiled
    """Return the weight of a residual ``u`` in kernel widths (Babin et al. 2019, arXiv:1810.01474)."""
    if kernel == 1:
        return (1.0 - u * u) ** 2 if abs(u) < 1.0 else 0.0
    if kernel == 2:
        return 1.0 if abs(u) <= 1.0 else 1.0 / abs(u)
    if kernel == 3:
        return 1.0 / (1.0 + u * u)
    if kernel == 4:
        return 1.0 / (1.0 + u * u) ** 2
    return 1.0


@njit(cache=True)
def plane_equations(
    points: FloatArray,
    normals: FloatArray,
    row: IntArray,
    moved: FloatArray,
    centre: FloatArray,
    radius: float,
    width: float,
    kernel: int,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return Hessian (6, 6) and gradient (6,) of the weighted squared distances
    ``n . (p + t + phi x (p - centre) - q)``.

    The unknowns are t and phi times the radius, ``[x y z rx ry rz]``; ``width`` is that of the robust kernel.
    """
    H, g, J = np.zeros((6, 6)), np.zeros(6), np.zeros(6)
    for i in range(len(row)):
        j = row[i]
        if j < 0:
            continue
        nx, ny, nz = normals[j, 0], normals[j, 1], normals[j, 2]
        residual = (
            (moved[i, 0] - points[j, 0]) * nx
            + (moved[i, 1] - points[j, 1]) * ny
            + (moved[i, 2] - points[j, 2]) * nz
        )
        w = weight_of(residual / width, kernel)
        if w <= 0.0:
            continue
        ox, oy, oz = moved[i, 0] - centre[0], moved[i, 1] - centre[1], moved[i, 2] - centre[2]
        ox, oy, oz = ox / radius, oy / radius, oz / radius
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = cross(ox, oy, oz, nx, ny, nz)
        for a in range(6):
            wj = w * J[a]
            g[a] += wj * residual
            for b in range(a + 1):
                H[a, b] += wj * J[b]
    _fill_upper_triangle(H)
    return H, g


@njit(cache=True)
def distribution_equations(
    means: FloatArray,
    information: FloatArray,
    row: IntArray,
    moved: FloatArray,
    centre: FloatArray,
    radius: float,
    width: float,
) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return Hessian (6, 6) and gradient (6,) of the distances to normal distributions, weighted by
    ``exp(-d^2 / (2 width^2))``.

    d is the Mahalanobis distance ``sqrt(e^T A e)`` of ``e = p - mean``, and A are the inverse covariances
    (m, 3, 3) in ``information``. The unknowns are those of ``plane_equations``.
    """
    H, g, e = np.zeros((6, 6)), np.zeros(6), np.zeros(3)
    J, AJ = np.zeros((3, 6)), np.zeros((3, 6))
    for c in range(3):
        J[c, c] = 1.0
    for i in range(len(row)):
        j = row[i]
        if j < 0:
            continue
        for c in range(3):
            e[c] = moved[i, c] - means[j, c]
        A = information[j]
        d2 = 0.0
        for a in range(3):
            d2 += e[a] * (A[a, 0] * e[0] + A[a, 1] * e[1] + A[a, 2] * e[2])
        w = np.exp(-0.5 * d2 / (width * width))
        ox, oy, oz = moved[i, 0] - centre[0], moved[i, 1] - centre[1], moved[i, 2] - centre[2]
        ox, oy, oz = ox / radius, oy / radius, oz / radius
        J[0, 4], J[0, 5], J[1, 3], J[1, 5], J[2, 3], J[2, 4] = oz, -oy, -oz, ox, oy, -ox
        for a in range(3):
            for b in range(6):
                AJ[a, b] = w * (A[a, 0] * J[0, b] + A[a, 1] * J[1, b] + A[a, 2] * J[2, b])
        for a in range(6):
            g[a] += AJ[0, a] * e[0] + AJ[1, a] * e[1] + AJ[2, a] * e[2]
            for b in range(a + 1):
                H[a, b] += J[0, a] * AJ[0, b] + J[1, a] * AJ[1, b] + J[2, a] * AJ[2, b]
    _fill_upper_triangle(H)
    return H, g


@njit(cache=True, inline="always")
def _fill_upper_triangle(H: FloatArray) -> None:  # pragma: no cover - compiled
    """Copy the lower triangle to the upper one."""
    for a in range(6):
        for b in range(a):
            H[b, a] = H[a, b]

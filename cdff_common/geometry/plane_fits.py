# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled plane fits of point neighbourhoods."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.geometry.kdtree import KdTree, nearest_rows, scratch

Float = NDArray[np.float64]

#: Largest number of Jacobi sweeps over a 3 x 3 matrix.
_SWEEPS = 12


@njit(cache=True)
def plane_fits(tree: KdTree, count: int) -> tuple[Float, Float, Float]:  # pragma: no cover - compiled
    """Fit a plane to the ``count`` nearest points of each point of a tree, including itself.

    Returns
    -------
    tuple of ndarray
        Unit normals (n, 3) of arbitrary sign, means of the neighbourhoods (n, 3), and their variances (n, 3)
        ascending, square metres; in the order of the original cloud.
    """
    n = len(tree.points)
    normals, means, variances = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, 3))
    nodes, bounds = scratch()
    rows, d2s = np.empty(count, np.int64), np.empty(count)
    scatter, vectors, mean, values = np.empty((3, 3)), np.empty((3, 3)), np.empty(3), np.empty(3)
    worst = np.inf
    for k in range(n):
        p = tree.points[k]
        size = nearest_rows(tree, p[0], p[1], p[2], worst, rows, d2s, nodes, bounds)
        if k + 1 < n and size == count:
            # The neighbours of this point bound the distance to the most distant neighbour of the next one.
            q, step2 = tree.points[k + 1], 0.0
            for c in range(3):
                step2 += (q[c] - p[c]) ** 2
            worst = 1.000001 * (math.sqrt(d2s[size - 1]) + math.sqrt(step2)) ** 2 + 1e-300
        mean[:] = 0.0
        for j in range(size):
            for c in range(3):
                mean[c] += tree.points[rows[j], c]
        mean /= size
        scatter[:] = 0.0
        for j in range(size):
            x = tree.points[rows[j], 0] - mean[0]
            y = tree.points[rows[j], 1] - mean[1]
            z = tree.points[rows[j], 2] - mean[2]
            scatter[0, 0] += x * x
            scatter[1, 0] += x * y
            scatter[1, 1] += y * y
            scatter[2, 0] += x * z
            scatter[2, 1] += y * z
            scatter[2, 2] += z * z
        scatter /= size
        i = tree.order[k]
        if not _flat_eigen(scatter, values, normals[i]):
            eigen(scatter, values, vectors)
            normals[i] = vectors[:, 0]
        for c in range(3):
            means[i, c], variances[i, c] = mean[c], max(values[c], 0.0)
    return normals, means, variances


@njit(cache=True)
def _flat_eigen(m: Float, values: Float, axis: Float) -> bool:  # pragma: no cover - compiled
    """Compute eigenvalues (3,), ascending, and the eigenvector (3,) of the least one, of a lower symmetric
    matrix; return False if the least two eigenvalues are too close for it.

    Closed form (Smith 1961, doi:10.1145/355578.366316): the eigenvector is normal to the rows of
    ``m - value I``.
    """
    xx, yy, zz, xy, xz, yz = m[0, 0], m[1, 1], m[2, 2], m[1, 0], m[2, 0], m[2, 1]
    mean = (xx + yy + zz) / 3.0
    a, b, c = xx - mean, yy - mean, zz - mean
    p = math.sqrt((a * a + b * b + c * c + 2.0 * (xy * xy + xz * xz + yz * yz)) / 6.0)
    if p <= 1e-12 * mean:
        return False
    determinant = a * (b * c - yz * yz) - xy * (xy * c - yz * xz) + xz * (xy * yz - b * xz)
    angle = math.acos(min(max(0.5 * determinant / (p * p * p), -1.0), 1.0)) / 3.0
    values[2] = mean + 2.0 * p * math.cos(angle)
    values[0] = mean + 2.0 * p * math.cos(angle + 2.0 * math.pi / 3.0)
    values[1] = 3.0 * mean - values[0] - values[2]
    if values[1] - values[0] <= 1e-3 * values[2]:
        return False
    a, b, c = xx - values[0], yy - values[0], zz - values[0]
    square = 0.0
    for x, y, z in (
        (xy * yz - xz * b, xz * xy - a * yz, a * b - xy * xy),
        (xy * c - xz * yz, xz * xz - a * c, a * yz - xy * xz),
        (b * c - yz * yz, yz * xz - xy * c, xy * yz - b * xz),
    ):
        if x * x + y * y + z * z > square:
            square = x * x + y * y + z * z
            axis[0], axis[1], axis[2] = x, y, z
    length = math.sqrt(square)
    x, y, z = axis[0] / length, axis[1] / length, axis[2] / length
    axis[0], axis[1], axis[2] = x, y, z
    # The quotient has a smaller rounding error than the root.
    values[0] = xx * x * x + yy * y * y + zz * z * z + 2.0 * (xy * x * y + xz * x * z + yz * y * z)
    return True


@njit(cache=True)
def eigen(m: Float, values: Float, vectors: Float) -> None:  # pragma: no cover - compiled
    """Compute eigenvalues (3,), ascending, and eigenvectors (3, 3), as columns, of a lower symmetric matrix.

    Cyclic Jacobi rotations (Golub, Van Loan, Matrix Computations, 8.5); ``m`` is overwritten.
    """
    m[0, 1], m[0, 2], m[1, 2] = m[1, 0], m[2, 0], m[2, 1]
    for i in range(3):
        for j in range(3):
            vectors[i, j] = 1.0 if i == j else 0.0
    for _ in range(_SWEEPS):
        off = m[0, 1] * m[0, 1] + m[0, 2] * m[0, 2] + m[1, 2] * m[1, 2]
        if off <= 1e-30 * (m[0, 0] * m[0, 0] + m[1, 1] * m[1, 1] + m[2, 2] * m[2, 2]):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if m[p, q] == 0.0:
                    continue
                theta = (m[q, q] - m[p, p]) / (2.0 * m[p, q])
                t = 1.0 / (abs(theta) + math.sqrt(theta * theta + 1.0))
                if theta < 0.0:
                    t = -t
                c = 1.0 / math.sqrt(t * t + 1.0)
                s = t * c
                r = 3 - p - q
                m[p, p], m[q, q] = m[p, p] - t * m[p, q], m[q, q] + t * m[p, q]
                m[p, q] = m[q, p] = 0.0
                rp, rq = m[r, p], m[r, q]
                m[r, p] = m[p, r] = c * rp - s * rq
                m[r, q] = m[q, r] = s * rp + c * rq
                for i in range(3):
                    vp, vq = vectors[i, p], vectors[i, q]
                    vectors[i, p], vectors[i, q] = c * vp - s * vq, s * vp + c * vq
    for i in range(3):
        values[i] = m[i, i]
    for i in range(2):
        for j in range(2 - i):
            if values[j] > values[j + 1]:
                swapped = values[j]
                values[j] = values[j + 1]
                values[j + 1] = swapped
                for c in range(3):
                    swapped = vectors[c, j]
                    vectors[c, j] = vectors[c, j + 1]
                    vectors[c, j + 1] = swapped

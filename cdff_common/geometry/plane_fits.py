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
    for k in range(n):
        p = tree.points[k]
        size = nearest_rows(tree, p[0], p[1], p[2], rows, d2s, nodes, bounds)
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
        eigen(scatter, values, vectors)
        i = tree.order[k]
        for c in range(3):
            normals[i, c], means[i, c], variances[i, c] = vectors[c, 0], mean[c], max(values[c], 0.0)
    return normals, means, variances


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

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over points and cells; the public functions of the package check their arguments.

Single-threaded: a parallel sum depends on the number of threads, and replay must not.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]


@njit(cache=True)
def finite_bounds(points: Float) -> tuple[int, float, float, float, float]:  # pragma: no cover - compiled
    """Number of finite rows of ``(n, 3)``, and the least x, least y, greatest x and greatest y of them."""
    n, xmin, ymin, xmax, ymax = 0, np.inf, np.inf, -np.inf, -np.inf
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if math.isfinite(x) and math.isfinite(y) and math.isfinite(z):
            n += 1
            xmin, xmax = min(x, xmin), max(x, xmax)
            ymin, ymax = min(y, ymin), max(y, ymax)
    return n, xmin, ymin, xmax, ymax


@njit(cache=True)
def accumulate(
    points: Float,
    stamps: Int,
    variances: Float,
    resolution: float,
    left: int,
    top: int,
    cols: int,
    count: Float,
    mean: Float,
    m2: Float,
    minimum: Float,
    maximum: Float,
    newest: Int,
) -> None:  # pragma: no cover - compiled
    """Fill empty statistics, flat arrays of ``rows * cols`` cells, from points ``(n, 3)``.

    One pass over the points for each statistic: each then works on one array, which stays in the cache where all
    together would not. The second moment is taken about the cell's mean (two-pass), so that it keeps its digits however
    far the heights are from zero.
    """
    n, rows = len(points), len(count) // cols
    cell, z = np.empty(n, np.int64), np.empty(n)
    for i in range(n):
        col = math.floor(points[i, 0] / resolution) - left
        row = top - 1 - math.floor(points[i, 1] / resolution)
        z[i] = points[i, 2]
        inside = math.isfinite(points[i, 0] + points[i, 1] + z[i]) and 0 <= col < cols and 0 <= row < rows
        cell[i] = row * cols + col if inside else -1
    first = 0.0
    for i in range(n):
        if cell[i] >= 0:
            first = z[i]
            break
    for i in range(n):
        if cell[i] >= 0:
            count[cell[i]] += 1.0
    for i in range(n):
        if cell[i] >= 0:
            mean[cell[i]] += z[i] - first
    for k in range(rows * cols):
        if count[k] > 0.0:
            mean[k] = first + mean[k] / count[k]
    one = len(variances) == 1
    for i in range(n):
        if cell[i] >= 0:
            d = z[i] - mean[cell[i]]
            m2[cell[i]] += d * d + (variances[0] if one else variances[i])
    for i in range(n):
        if cell[i] >= 0 and z[i] < minimum[cell[i]]:
            minimum[cell[i]] = z[i]
    for i in range(n):
        if cell[i] >= 0 and z[i] > maximum[cell[i]]:
            maximum[cell[i]] = z[i]
    one = len(stamps) == 1
    for i in range(n):
        if cell[i] >= 0:
            stamp = stamps[0] if one else stamps[i]
            if stamp > newest[cell[i]]:
                newest[cell[i]] = stamp

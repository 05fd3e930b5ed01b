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


@njit(cache=True, fastmath=False)
def accumulate(
    points: Float,
    stamps: NDArray[np.int64],
    variances: Float,
    resolution: float,
    left: int,
    top: int,
    count: Float,
    mean: Float,
    m2: Float,
    minimum: Float,
    maximum: Float,
    newest: NDArray[np.int64],
) -> None:  # pragma: no cover - compiled
    """Fill empty statistics ``(rows, cols)`` from points ``(n, 3)``.

    While filling, a cell is one row of ``work``, so that a point touches one cache line; sums are taken relative to
    the cell's first height, which keeps them exact far from the datum.
    """
    rows, cols = count.shape
    work = np.zeros((rows * cols, 6))  # count, first height, sum, sum of squares (+ variances), min, max
    one_stamp, one_variance = len(stamps) == 1, len(variances) == 1
    for i in range(len(points)):
        x, y, z = points[i, 0], points[i, 1], points[i, 2]
        if not (math.isfinite(x) and math.isfinite(y) and math.isfinite(z)):
            continue
        col = math.floor(x / resolution) - left
        row = top - 1 - math.floor(y / resolution)
        if col < 0 or col >= cols or row < 0 or row >= rows:
            continue
        cell = int(row) * cols + int(col)
        extra = variances[0] if one_variance else variances[i]
        stamp = stamps[0] if one_stamp else stamps[i]
        if work[cell, 0] == 0.0:
            work[cell, 0] = 1.0
            work[cell, 1] = z
            work[cell, 3] = extra
            work[cell, 4] = z
            work[cell, 5] = z
            newest[row, col] = stamp
        else:
            d = z - work[cell, 1]
            work[cell, 0] += 1.0
            work[cell, 2] += d
            work[cell, 3] += d * d + extra
            if z < work[cell, 4]:
                work[cell, 4] = z
            if z > work[cell, 5]:
                work[cell, 5] = z
            if stamp > newest[row, col]:
                newest[row, col] = stamp
    for row in range(rows):
        for col in range(cols):
            cell = row * cols + col
            n = work[cell, 0]
            if n > 0.0:
                offset = work[cell, 2] / n
                count[row, col] = n
                mean[row, col] = work[cell, 1] + offset
                m2[row, col] = max(work[cell, 3] - work[cell, 2] * offset, 0.0)
                minimum[row, col] = work[cell, 4]
                maximum[row, col] = work[cell, 5]

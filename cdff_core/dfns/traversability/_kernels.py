# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Plane fits around every cell of a grid; compiled, single-threaded, so that results do not depend on
threads.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray

#: Minimum ratio of the product to the squared mean of the two eigenvalues of the second moments of the
#: observed cells: below it the cells lie along a line and do not constrain the slope across it.
_MIN_EIGENVALUE_RATIO = 0.05


@njit(cache=True)
def fit_planes(
    z: FloatArray, half: int, min_cells: int
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Fit planes to the observed heights in the square of ``2 half + 1`` cells around each cell, by least
    squares.

    Sums are updated from row to row and from cell to cell, so that the cost does not depend on the size of
    the square.

    Returns
    -------
    gradient, rms, middle, leverage : ndarray, shape (rows, cols)
        Slope of the plane (height per cell), root mean square distance of the heights from the plane along z,
        height of the plane at the cell, and variance of that height if every height has variance 1. NaN, the
        leverage infinite, if fewer than ``min_cells`` cells are observed or they lie along a line.
    """
    rows, cols = z.shape
    gradient, rms = np.full((rows, cols), np.nan), np.full((rows, cols), np.nan)
    middle, leverage = np.full((rows, cols), np.nan), np.full((rows, cols), np.inf)
    column = np.zeros((cols, 6))  # n, z, zz, y, yy, yz over the rows of the window
    for r in range(-half, rows):
        for sign, row in ((1.0, r + half), (-1.0, r - half - 1)):
            if 0 <= row < rows:
                for c in range(cols):
                    v = z[row, c]
                    if math.isfinite(v):
                        column[c, 0] += sign
                        column[c, 1] += sign * v
                        column[c, 2] += sign * v * v
                        column[c, 3] += sign * row
                        column[c, 4] += sign * row * row
                        column[c, 5] += sign * row * v
        if r < 0:
            continue
        n = sz = szz = sy = syy = syz = sx = sxx = sxy = sxz = 0.0
        for c in range(-half, cols):
            for sign, k in ((1.0, c + half), (-1.0, c - half - 1)):
                if 0 <= k < cols:
                    m = sign * column[k, 0]
                    n += m
                    sz += sign * column[k, 1]
                    szz += sign * column[k, 2]
                    sy += sign * column[k, 3]
                    syy += sign * column[k, 4]
                    syz += sign * column[k, 5]
                    sx += m * k
                    sxx += m * k * k
                    sxy += sign * column[k, 3] * k
                    sxz += sign * column[k, 1] * k
            if c < 0 or n < min_cells:
                continue
            xx, yy, xy = sxx - sx * sx / n, syy - sy * sy / n, sxy - sx * sy / n
            xz, yz, zz = sxz - sx * sz / n, syz - sy * sz / n, szz - sz * sz / n
            det, mean = xx * yy - xy * xy, 0.5 * (xx + yy)
            if det <= _MIN_EIGENVALUE_RATIO * mean * mean:
                continue
            a, b = (xz * yy - yz * xy) / det, (yz * xx - xz * xy) / det
            gradient[r, c] = math.sqrt(a * a + b * b)
            rms[r, c] = math.sqrt(max(zz - a * xz - b * yz, 0.0) / n)
            dx, dy = c - sx / n, r - sy / n
            middle[r, c] = sz / n + a * dx + b * dy
            leverage[r, c] = 1.0 / n + (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / det
    return gradient, rms, middle, leverage

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled planes through the cells around points."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import Float32Array, FloatArray


@njit(cache=True)
def tangent_planes(
    points: FloatArray,
    heights: Float32Array,
    resolution_m: float,
    xmin_m: float,
    ymax_m: float,
    radius: int,
    above: FloatArray,
    gradient: FloatArray,
    spread: FloatArray,
) -> None:
    """Compute the height of each point over the least-squares plane of the surrounding cells, its gradient
    and scatter.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
    heights : ndarray of float32, shape (rows, cols)
        NaN where unobserved.
    radius : int
        Cells to each side of the point's own.
    above, gradient, spread : ndarray, shapes (n,), (n, 2), (n,)
        Outputs: metres; slopes along x and y; variance of the cells about the plane over their number, square
        metres. NaN where the cells do not span a plane.
    """
    rows, cols = heights.shape
    least = ((2 * radius + 1) ** 2) // 2
    for i in range(len(points)):
        above[i] = np.nan
        u, v = (points[i, 0] - xmin_m) / resolution_m, (ymax_m - points[i, 1]) / resolution_m
        col, row = int(np.floor(u)), int(np.floor(v))
        if row < radius or col < radius or row + radius >= rows or col + radius >= cols:
            continue
        n, sx, sy, sz, sxx, sxy, syy, sxz, syz, szz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for r in range(row - radius, row + radius + 1):
            for c in range(col - radius, col + radius + 1):
                z = np.float64(heights[r, c])
                if np.isnan(z):
                    continue
                z -= points[i, 2]
                x, y = (c + 0.5 - u) * resolution_m, (v - r - 0.5) * resolution_m
                n += 1.0
                sx += x
                sy += y
                sz += z
                sxx += x * x
                sxy += x * y
                syy += y * y
                sxz += x * z
                syz += y * z
                szz += z * z
        if n < least:
            continue
        mx, my, mz = sx / n, sy / n, sz / n
        a, b, d = sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my
        p, q = sxz / n - mx * mz, syz / n - my * mz
        determinant = a * d - b * b
        if determinant < 1e-3 * (a + d) * (a + d):
            continue
        gx, gy = (d * p - b * q) / determinant, (a * q - b * p) / determinant
        above[i] = -(mz - gx * mx - gy * my)
        gradient[i, 0], gradient[i, 1] = gx, gy
        spread[i] = max(szz / n - mz * mz - gx * p - gy * q, 0.0) / n

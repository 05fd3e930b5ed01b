# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled least-squares planes through the map cells around points."""

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
    height_above_m: FloatArray,
    gradient: FloatArray,
    plane_variance_m2: FloatArray,
) -> None:
    """Fit a plane to the cells around each point; compute its gradient, variance and the height above it.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In the frame of the map, metres.
    heights : ndarray of float32, shape (rows, cols)
        Mean height of each cell, metres; NaN if unobserved.
    resolution_m, xmin_m, ymax_m : float
        Edge of a cell and outer corner of the cell (0, 0).
    radius : int
        Half width of the fitted square: cells on each side of the cell that contains the point.
    height_above_m, gradient, plane_variance_m2 : ndarray, shapes (n,), (n, 2), (n,)
        Outputs: height of the point above the plane; slopes of the plane along x and y; variance of the plane
        height, which is that of the cell heights about the plane over the number of cells. The height is NaN,
        and the others are not written, if fewer than half of the cells are observed or they do not span a
        plane.
    """
    rows, cols = heights.shape
    min_cells = ((2 * radius + 1) ** 2) // 2
    for i in range(len(points)):
        height_above_m[i] = np.nan
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
        if n < min_cells:
            continue
        mx, my, mz = sx / n, sy / n, sz / n
        a, b, d = sxx / n - mx * mx, sxy / n - mx * my, syy / n - my * my
        p, q = sxz / n - mx * mz, syz / n - my * mz
        determinant = a * d - b * b
        if determinant < 1e-3 * (a + d) * (a + d):
            continue
        gx, gy = (d * p - b * q) / determinant, (a * q - b * p) / determinant
        height_above_m[i] = -(mz - gx * mx - gy * my)
        gradient[i, 0], gradient[i, 1] = gx, gy
        plane_variance_m2[i] = max(szz / n - mz * mz - gx * p - gy * q, 0.0) / n

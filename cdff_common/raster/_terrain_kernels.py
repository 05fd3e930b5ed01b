# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of the terrain analyses; ``surface`` and ``viewshed`` check their arguments."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]


@njit(cache=True, nogil=True)
def fit_planes(
    z: Float, noise: Float, half: int, cell_m: float, fewest: int, out: Float
) -> None:  # pragma: no cover - compiled
    """Fit a plane to the square of ``2 half + 1`` cells around each cell, by least squares.

    ``z`` and ``noise`` are ``(rows, cols)``; ``out`` is ``(6, rows, cols)``: derivatives along +x and +y, the
    variances of both and their covariance, and the variance of the heights about the plane without the noise.
    Cells with less than ``fewest`` observed neighbours keep their values.
    """
    rows, cols = z.shape
    for r in range(rows):
        for c in range(cols):
            z0 = z[r, c]
            if not math.isfinite(z0):
                continue
            n = 0
            sx = sy = sxx = sxy = syy = sz = sxz = syz = szz = sn = 0.0
            for i in range(max(r - half, 0), min(r + half + 1, rows)):
                y = -(i - r) * cell_m
                for j in range(max(c - half, 0), min(c + half + 1, cols)):
                    d = z[i, j] - z0
                    if not math.isfinite(d):
                        continue
                    x = (j - c) * cell_m
                    n += 1
                    sx += x
                    sy += y
                    sxx += x * x
                    sxy += x * y
                    syy += y * y
                    sz += d
                    sxz += x * d
                    syz += y * d
                    szz += d * d
                    sn += noise[i, j]
            if n < fewest:
                continue
            xx, xy, yy = sxx - sx * sx / n, sxy - sx * sy / n, syy - sy * sy / n
            xz, yz, zz = sxz - sx * sz / n, syz - sy * sz / n, szz - sz * sz / n
            det = xx * yy - xy * xy
            if det <= 1e-6 * (cell_m * cell_m) ** 2:
                continue
            a, b = (yy * xz - xy * yz) / det, (xx * yz - xy * xz) / det
            mean_noise = sn / n
            out[0, r, c], out[1, r, c] = a, b
            out[2, r, c], out[3, r, c] = mean_noise * yy / det, mean_noise * xx / det
            out[4, r, c] = -mean_noise * xy / det
            about = max(zz - a * xz - b * yz, 0.0) / (n - 3) if n > 3 else math.nan
            out[5, r, c] = max(about - mean_noise, 0.0) if math.isfinite(mean_noise) else about


@njit(cache=True, nogil=True)
def hidden_heights(
    z: Float,
    noise: Float,
    row: int,
    col: int,
    eye_m: float,
    reach_cells: float,
    first: int,
    last: int,
    required: Float,
    variance: Float,
    unobserved: Float,
) -> None:  # pragma: no cover - compiled
    """Compute the height above the ground that is visible from an observer, in the rows first to last - 1.

    Each line of sight is sampled once in each row or column that it crosses, whichever are more, between the
    two nearest cells. ``eye_m`` is the height of the eye above the centre of the observer's cell.
    """
    rows, cols = z.shape
    z_eye = z[row, col] + eye_m
    for r in range(first, last):
        for c in range(cols):
            dr, dc = r - row, c - col
            if not math.isfinite(z[r, c]) or math.sqrt(dr * dr + dc * dc) > reach_cells:
                continue
            steps = max(abs(dr), abs(dc))
            is_steep = abs(dr) >= abs(dc)
            # From one sample to the next a whole step along one axis, and a part of one along the other.
            step_r, step_c = dr / max(steps, 1), dc / max(steps, 1)
            steepest, at, at_noise, unknown = -math.inf, 1.0, 0.0, 0
            for k in range(1, steps):
                if is_steep:
                    cf = col + step_c * k
                    r0, c0 = row + (k if dr > 0 else -k), int(cf)
                    r1, c1, w = r0, min(c0 + 1, cols - 1), cf - c0
                else:
                    rf = row + step_r * k
                    r0, c0 = int(rf), col + (k if dc > 0 else -k)
                    r1, c1, w = min(r0 + 1, rows - 1), c0, rf - r0
                za, zb = z[r0, c0], z[r1, c1]
                height = za + (zb - za) * w
                if math.isnan(height):
                    height = za if math.isnan(zb) else zb
                    if math.isnan(height) or (math.isnan(za) and w < 1e-9):
                        unknown += 1
                        continue
                rise = (height - z_eye) * steps
                if rise > steepest * k:
                    steepest, at = rise / k, k / steps
                    at_noise = noise[r1, c1] if w > 0.5 else noise[r0, c0]
            unobserved[r, c] = unknown / (steps - 1) if steps > 1 else 0.0
            required[r, c] = z_eye + steepest - z[r, c]
            variance[r, c] = noise[r, c]
            if steepest > -math.inf:
                variance[r, c] += at_noise / at**2 + noise[row, col] * (1.0 / at - 1.0) ** 2

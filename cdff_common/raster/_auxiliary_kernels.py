# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over the auxiliary layers; the callers check the arguments."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.raster.auxiliary_layers import (
    AREA_SUM,
    COUNT_SQUARES,
    FIRST_US,
    INTENSITY_COUNT,
    INTENSITY_SUM,
    OVERHANG_M,
    POSE_VARIANCE_SUM,
    X_SUM,
    Y_SUM,
)

#: Smallest displacement of the mean position that counts, cells; differences below are rounding errors.
_LEAST_DISPLACEMENT = 1e-4
#: Added to the second moments of positions, square cells.
_DIAGONAL = 0.05


@njit(cache=True, nogil=True, inline="always")
def pool_auxiliary(
    sums: FloatArray,
    row: int,
    col: int,
    n: float,
    x: float,
    y: float,
    squares: float,
    area: float,
    pose: float,
    intensity: float,
    first_us: float,
    overhang: float,
) -> None:  # pragma: no cover - compiled
    """Add ``n`` heights of a map's cell, which covers the fraction ``area``, to a cell of the window.

    ``x`` and ``y`` are the centre of the map's cell in the frame of the window, metres.
    ``squares`` is added to the sum of the squared numbers of heights. A NaN in ``pose`` makes that of the
    cell unknown.
    """
    sums[row, col, COUNT_SQUARES] += squares
    sums[row, col, AREA_SUM] += n * area
    sums[row, col, X_SUM] += n * x
    sums[row, col, Y_SUM] += n * y
    sums[row, col, POSE_VARIANCE_SUM] += n * pose
    if math.isfinite(intensity):
        sums[row, col, INTENSITY_SUM] += n * intensity
        sums[row, col, INTENSITY_COUNT] += n
    if first_us < sums[row, col, FIRST_US]:
        sums[row, col, FIRST_US] = first_us
    if overhang < sums[row, col, OVERHANG_M]:
        sums[row, col, OVERHANG_M] = overhang


@njit(cache=True, nogil=True, inline="always")
def first_us_of(t1_ns: int, age_s: float) -> float:  # pragma: no cover - compiled
    """Return the stamp of the oldest measurement, -inf if its age is unknown."""
    return t1_ns * 1e-3 - 1e6 * age_s if math.isfinite(age_s) else -np.inf


@njit(cache=True, nogil=True)
def relief(count: FloatArray, mean: FloatArray, out: FloatArray) -> int:  # pragma: no cover - compiled
    """Fill ``out (rows, cols)`` with the mean squared difference to the observed neighbours, NaN if there is
    none.

    Returns
    -------
    isolated : int
        Number of observed cells without an observed neighbour.
    """
    rows, cols = count.shape
    isolated = 0
    for r in range(rows):
        for c in range(cols):
            out[r, c] = np.nan
            if not count[r, c] > 0.0:
                continue
            z, squares, pairs = mean[r, c], 0.0, 0
            for i, j in ((r - 1, c), (r + 1, c), (r, c - 1), (r, c + 1)):
                if 0 <= i < rows and 0 <= j < cols and count[i, j] > 0.0:
                    squares += (z - mean[i, j]) * (z - mean[i, j])
                    pairs += 1
            if pairs:
                out[r, c] = squares / pairs
            else:
                isolated += 1
    return isolated


@njit(cache=True, nogil=True)
def sampling_errors(
    count: FloatArray,
    mean: FloatArray,
    sums: FloatArray,
    squares: FloatArray,
    typical: float,
    x_m: FloatArray,
    y_m: FloatArray,
    resolution_m: float,
    out: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Fill ``out (rows, cols)`` with the squared difference of the mean height from that of the cell, due to
    the displacement of the mean position from the centre of the cell, m2.

    ``squares`` is the output of ``relief``; ``typical`` replaces it in cells without neighbours. ``x_m`` and
    ``y_m`` are the centres of columns and rows.
    """
    rows, cols = count.shape
    for r in range(rows):
        for c in range(cols):
            out[r, c] = 0.0
            if not sums[r, c, COUNT_SQUARES] > 0.0:
                continue
            dx = sums[r, c, X_SUM] / count[r, c] - x_m[c]
            dy = sums[r, c, Y_SUM] / count[r, c] - y_m[r]
            distance2 = (dx * dx + dy * dy) / (resolution_m * resolution_m)
            if distance2 < _LEAST_DISPLACEMENT * _LEAST_DISPLACEMENT:
                continue
            along_x, along_y = plane_gradient(r, c, count, mean, sums, x_m, y_m, resolution_m)
            along = along_x * dx + along_y * dy
            ground = typical if math.isnan(squares[r, c]) else squares[r, c]
            out[r, c] = max(along * along, ground * distance2)


@njit(cache=True, nogil=True)
def plane_gradient(
    row: int,
    col: int,
    count: FloatArray,
    mean: FloatArray,
    sums: FloatArray,
    x_m: FloatArray,
    y_m: FloatArray,
    resolution_m: float,
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Return the gradient of the plane through the mean positions of a cell and its eight neighbours.

    It is 0 with fewer than four observed cells. A small constant on the diagonal keeps cells in a line
    solvable.
    """
    rows, cols = count.shape
    n, x, y, z, xx, xy, yy, xz, yz = 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(max(row - 1, 0), min(row + 2, rows)):
        for j in range(max(col - 1, 0), min(col + 2, cols)):
            # The mean position is unknown if a height of the cell has no auxiliary layers.
            if sums[i, j, COUNT_SQUARES] > 0.0 and not math.isnan(sums[i, j, POSE_VARIANCE_SUM]):
                px = (sums[i, j, X_SUM] / count[i, j] - x_m[col]) / resolution_m
                py = (sums[i, j, Y_SUM] / count[i, j] - y_m[row]) / resolution_m
                pz = mean[i, j] - mean[row, col]
                n += 1
                x, y, z = x + px, y + py, z + pz
                xx, xy, yy = xx + px * px, xy + px * py, yy + py * py
                xz, yz = xz + px * pz, yz + py * pz
    if n < 4:
        return 0.0, 0.0
    xx, yy = xx - x * x / n + _DIAGONAL, yy - y * y / n + _DIAGONAL
    xy, xz, yz = xy - x * y / n, xz - x * z / n, yz - y * z / n
    determinant = (xx * yy - xy * xy) * resolution_m
    return (xz * yy - yz * xy) / determinant, (yz * xx - xz * xy) / determinant


@njit(cache=True, nogil=True)
def fill_auxiliary(
    count: FloatArray,
    mean: FloatArray,
    m2: FloatArray,
    sums: FloatArray,
    squares: FloatArray,
    displaced: FloatArray,
    typical: float,
    t1_us: float,
    out: Float32Array,
) -> tuple[bool, bool]:  # pragma: no cover - compiled
    """Fill ``(5, cells)`` layers pose_variance, error_variance, first_age_s, intensity, overhang_m.

    Returns whether any cell has an intensity and whether any has an overhang. Overhangs below the ground,
    which conflicting patches can produce, are discarded. ``squares`` is the output of ``relief``, and
    ``displaced`` that of ``sampling_errors``; ``typical`` replaces ``squares`` in cells without neighbours.
    """
    has_intensity, has_overhang = False, False
    for i in range(len(count)):
        n = count[i]
        for k in range(5):
            out[k, i] = np.nan
        if n > 0.0:
            pose = sums[i, POSE_VARIANCE_SUM] / n
            # Over a cell of edge r a slope s has the variance (s r)^2 / 12 along each axis; neighbours differ
            # by s r.
            ground = (typical if math.isnan(squares[i]) else squares[i]) * (2.0 / 12.0)
            heights = max(m2[i] / n - pose, 0.0)
            area, clusters, between = 1.0, 0.0, heights
            if sums[i, COUNT_SQUARES] > 0.0:
                area = sums[i, AREA_SUM] / n
                squared_fractions = min(sums[i, COUNT_SQUARES] / (n * n), 1.0)
                clusters = max(squared_fractions - area, 0.0)
                # The variance about the mean of few clusters is too small by this factor.
                between = heights / max(1.0 - squared_fractions, 0.5)
            spread = (heights + area * ground) / max(n, 1.0) + max(between, ground) * clusters
            out[0, i], out[1, i] = pose, pose + spread + displaced[i]
            if math.isfinite(sums[i, FIRST_US]):
                out[2, i] = (t1_us - sums[i, FIRST_US]) * 1e-6
        if sums[i, INTENSITY_COUNT] > 0.0:
            out[3, i] = sums[i, INTENSITY_SUM] / sums[i, INTENSITY_COUNT]
            has_intensity = True
        if math.isfinite(sums[i, OVERHANG_M]):
            has_overhang = True
            if not sums[i, OVERHANG_M] <= mean[i]:
                out[4, i] = sums[i, OVERHANG_M]
    return has_intensity, has_overhang

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
Single = NDArray[np.float32]
Flags = NDArray[np.bool_]


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True, inline="always")
def _pool(
    row: int, col: int, n: float, z: float, m2: float, low: float, high: float, stamp: int,
    count: Float, mean: Float, total: Float, minimum: Float, maximum: Float, newest: Int, within: Float,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """Chan's update of one cell by another."""
    before = count[row, col]
    after = before + n
    d = z - mean[row, col]
    share = n / after
    total[row, col] += m2 + d * d * before * share
    within[row, col] += m2
    mean[row, col] += d * share
    count[row, col] = after
    minimum[row, col] = min(minimum[row, col], low)
    maximum[row, col] = max(maximum[row, col], high)
    newest[row, col] = max(newest[row, col], stamp)


@njit(cache=True, nogil=True)
def pool_layers(
    layers: tuple[Single, ...], t1: int, factor: int, down: int, right: int,
    count: Float, mean: Float, m2: Float, minimum: Float, maximum: Float, newest: Int, within: Float,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """Pool a patch's layers ``(rows, cols)`` mean, variance, min, max, count, age_s into a window's statistics.

    ``factor`` cells of the patch make one of the window along an edge; cell (0, 0) of the patch lies ``down`` and
    ``right`` of the window's corner, in cells of the patch. What lies outside the window is left out.
    """
    means, variances, lows, highs, counts, ages = layers
    rows, cols = means.shape
    for r in range(max(0, -down), min(rows, count.shape[0] * factor - down)):
        row = (r + down) // factor
        for c in range(max(0, -right), min(cols, count.shape[1] * factor - right)):
            n, z = np.float64(counts[r, c]), np.float64(means[r, c])
            if not (n > 0.0 and math.isfinite(z)):
                continue
            age = np.float64(ages[r, c])
            stamp = t1 - math.floor(age * 1e9 + 0.5) if math.isfinite(age) else t1
            _pool(
                row, (c + right) // factor, n, z, n * np.float64(variances[r, c]), np.float64(lows[r, c]),
                np.float64(highs[r, c]), stamp, count, mean, m2, minimum, maximum, newest, within,
            )  # fmt: skip


@njit(cache=True, nogil=True, inline="always")
def landing(
    part: int, col: int, row: int, z: float, fine: float, T: Float, covariance: Float, coarse: float,
    left: int, top: int,
) -> tuple[int, int, float, float]:  # pragma: no cover - compiled  # fmt: skip
    """Where a quarter of a patch's cell falls: row and column of the window, height, and the variance that ``T`` adds.

    ``col`` and ``row`` count the patch's cells from its frame's origin, right and up to the cell's upper edge.
    """
    x = (col + 0.25 + 0.5 * (part % 2)) * fine
    y = (row - 0.25 - 0.5 * (part // 2)) * fine
    rx = T[0, 0] * x + T[0, 1] * y + T[0, 2] * z
    ry = T[1, 0] * x + T[1, 1] * y + T[1, 2] * z
    # A turn (wx, wy, wz) of the frame lifts the point by wx ry - wy rx.
    spread = (
        covariance[2, 2] + ry * ry * covariance[3, 3] + rx * rx * covariance[4, 4]
        + 2.0 * (ry * covariance[2, 3] - rx * covariance[2, 4] - rx * ry * covariance[3, 4])
    )  # fmt: skip
    return (
        top - 1 - math.floor((ry + T[1, 3]) / coarse), math.floor((rx + T[0, 3]) / coarse) - left,
        T[2, 0] * x + T[2, 1] * y + T[2, 2] * z + T[2, 3], max(spread, 0.0),
    )  # fmt: skip


@njit(cache=True, nogil=True)
def pool_moved(
    layers: tuple[Single, ...], t1: int, fine: float, left: int, top: int, T: Float, covariance: Float,
    coarse: float, window_left: int, window_top: int,
    count: Float, mean: Float, m2: Float, minimum: Float, maximum: Float, newest: Int, within: Float,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """As ``pool_layers`` for a patch in another frame, or of cells that do not fit the window's.

    Each cell is cut into 2 x 2 parts with a quarter of its heights each; a part falls whole into the cell of the window
    that its centre is carried into by ``T``. Parts of cells no larger than the window's leave no holes: the centres are
    at most 0.36 of a cell from any point, less than half a cell. ``covariance`` (6, 6), of ``T`` and in the window's
    frame, adds to the variance of each height.
    """
    means, variances, lows, highs, counts, ages = layers
    for r in range(means.shape[0]):
        for c in range(means.shape[1]):
            n, z = np.float64(counts[r, c]), np.float64(means[r, c])
            if not (n > 0.0 and math.isfinite(z)):
                continue
            age = np.float64(ages[r, c])
            stamp = t1 - math.floor(age * 1e9 + 0.5) if math.isfinite(age) else t1
            steep = T[2, 2]
            variance = np.float64(variances[r, c]) * steep * steep
            low, high = (np.float64(lows[r, c]) - z) * steep, (np.float64(highs[r, c]) - z) * steep
            for part in range(4):
                row, col, height, spread = landing(
                    part, left + c, top - r, z, fine, T, covariance, coarse, window_left, window_top
                )
                if 0 <= row < count.shape[0] and 0 <= col < count.shape[1]:
                    _pool(
                        row, col, 0.25 * n, height, 0.25 * n * (variance + spread), height + low, height + high,
                        stamp, count, mean, m2, minimum, maximum, newest, within,
                    )  # fmt: skip


@njit(cache=True, nogil=True)
def fill_layers(
    count: Float, mean: Float, m2: Float, minimum: Float, maximum: Float, newest: Int, t1: int, out: Single
) -> None:  # pragma: no cover - compiled
    """Fill ``(6, cells)`` layers mean, variance, min, max, count, age_s from flat statistics."""
    for i in range(len(count)):
        n = count[i]
        if n > 0.0:
            out[0, i], out[1, i], out[2, i], out[3, i] = mean[i], m2[i] / n, minimum[i], maximum[i]
            out[4, i], out[5, i] = n, (t1 - newest[i]) / 1e9
        else:
            for k in range(6):
                out[k, i] = np.nan


@njit(cache=True, nogil=True)
def disagreeing(
    count: Float, m2: Float, within: Float, sigmas: float, agreed: float, out: Flags
) -> int:  # pragma: no cover - compiled
    """Flag flat cells whose spread between patches exceeds ``sigmas`` spreads within them, and ``agreed`` metres."""
    found = 0
    for i in range(len(count)):
        between = m2[i] - within[i]
        if between > sigmas * sigmas * within[i] + agreed * agreed * count[i] and count[i] > 0.0:
            out[i] = True
            found += 1
    return found


@njit(cache=True, nogil=True)
def pool_blocks(
    cells: tuple[Float, ...], stamps: Int, factor: int, down: int, right: int,
    count: Float, mean: Float, m2: Float, minimum: Float, maximum: Float, newest: Int, within: Float,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """Pool statistics count, mean, m2, minimum, maximum ``(rows, cols)`` into coarser ones; see ``pool_layers``."""
    counts, means, squares, lows, highs = cells
    rows, cols = counts.shape
    for r in range(rows):
        for c in range(cols):
            if counts[r, c] > 0.0:
                _pool(
                    (r + down) // factor, (c + right) // factor, counts[r, c], means[r, c], squares[r, c], lows[r, c],
                    highs[r, c], stamps[r, c], count, mean, m2, minimum, maximum, newest, within,
                )  # fmt: skip

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over points and cells; the public functions of the package check their arguments.

Single-threaded: a parallel sum depends on the number of threads, and a replay must be repeatable.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.geometry.small_vectors import rotated
from cdff_common.raster._auxiliary_kernels import first_us_of, pool_auxiliary

Float = NDArray[np.float64]
Int = NDArray[np.int64]
Single = NDArray[np.float32]
Flags = NDArray[np.bool_]
#: count, mean, m2, minimum, maximum, newest_ns of a window, and the sum of m2 within its patches.
CellArrays = tuple[Float, Float, Float, Float, Float, Int, Float]


@njit(cache=True, nogil=True)
def finite_bounds(points: Float) -> tuple[int, float, float, float, float]:  # pragma: no cover - compiled
    """Return the number of finite rows of ``(n, 3)`` and their xmin, ymin, xmax, ymax."""
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

    One pass over the points per statistic: a single array stays in the cache, all of them do not. The second
    moment refers to the mean of the cell (two-pass), which avoids cancellation for heights far from zero.
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
    is_common = len(variances) == 1
    for i in range(n):
        if cell[i] >= 0:
            d = z[i] - mean[cell[i]]
            m2[cell[i]] += d * d + (variances[0] if is_common else variances[i])
    for i in range(n):
        if cell[i] >= 0 and z[i] < minimum[cell[i]]:
            minimum[cell[i]] = z[i]
    for i in range(n):
        if cell[i] >= 0 and z[i] > maximum[cell[i]]:
            maximum[cell[i]] = z[i]
    is_common = len(stamps) == 1
    for i in range(n):
        if cell[i] >= 0:
            stamp = stamps[0] if is_common else stamps[i]
            if stamp > newest[cell[i]]:
                newest[cell[i]] = stamp


@njit(cache=True, nogil=True, inline="always")
def _pool(
    row: int,
    col: int,
    n: float,
    z: float,
    m2: float,
    low: float,
    high: float,
    stamp: int,
    cells: CellArrays,
) -> None:  # pragma: no cover - compiled
    """Pool the statistics of ``n`` heights into a cell (Chan et al., see ``statistics``)."""
    count, mean, total, minimum, maximum, newest, within = cells
    count_before = count[row, col]
    count_after = count_before + n
    d = z - mean[row, col]
    share = n / count_after
    total[row, col] += m2 + d * d * count_before * share
    within[row, col] += m2
    mean[row, col] += d * share
    count[row, col] = count_after
    minimum[row, col] = min(minimum[row, col], low)
    maximum[row, col] = max(maximum[row, col], high)
    newest[row, col] = max(newest[row, col], stamp)


@njit(cache=True, nogil=True)
def pool_layers(
    layers: tuple[Single, ...],
    t1: int,
    fine: float,
    left: int,
    top: int,
    factor: int,
    down: int,
    right: int,
    cells: CellArrays,
    sums: Float,
) -> None:  # pragma: no cover - compiled
    """Pool a patch's layers ``(rows, cols)`` mean, variance, min, max, count, age_s and the auxiliary
    pose_variance, intensity, first_age_s, overhang_m into a window.

    The patch has cells of ``fine`` metres, whose first column and upper edge are ``left`` and ``top`` cells
    from the origin of the frame. A cell of the window has ``factor`` cells of the patch along an edge.
    Cell (0, 0) of the patch lies ``down`` and ``right`` of the window's corner, in cells of the patch. Cells
    outside the window are ignored. Without auxiliary layers ``sums`` (``AuxiliaryLayers.sums``) and these
    layers are empty.
    """
    means, variances, lows, highs, counts, ages, poses, intensities, first_ages, overhangs = layers
    rows, cols = means.shape
    window_rows, window_cols = cells[0].shape
    for r in range(max(0, -down), min(rows, window_rows * factor - down)):
        row = (r + down) // factor
        for c in range(max(0, -right), min(cols, window_cols * factor - right)):
            n, z = np.float64(counts[r, c]), np.float64(means[r, c])
            if not (n > 0.0 and math.isfinite(z)):
                continue
            age = np.float64(ages[r, c])
            stamp = t1 - math.floor(age * 1e9 + 0.5) if math.isfinite(age) else t1
            col, m2 = (c + right) // factor, n * np.float64(variances[r, c])
            _pool(row, col, n, z, m2, np.float64(lows[r, c]), np.float64(highs[r, c]), stamp, cells)
            if len(sums):
                first_us = first_us_of(t1, np.float64(first_ages[r, c]))
                pose, overhang = np.float64(poses[r, c]), np.float64(overhangs[r, c])
                intensity, area = np.float64(intensities[r, c]), 1.0 / (factor * factor)
                x, y = (left + c + 0.5) * fine, (top - r - 0.5) * fine
                pool_auxiliary(sums, row, col, n, x, y, n * n, area, pose, intensity, first_us, overhang)


@njit(cache=True, nogil=True, inline="always")
def target_cell(
    quarter: int,
    col: int,
    row: int,
    z: float,
    fine: float,
    T_window_patch: Float,
    covariance: Float,
    coarse: float,
    left: int,
    top: int,
) -> tuple[int, int, float, float, float, float]:  # pragma: no cover - compiled
    """Return row and column of the window's cell at a quarter of a patch's cell, the position of the quarter
    in the frame of the window, and the variance that ``T_window_patch`` adds to its height.

    ``col`` and ``row`` count the patch's cells from the origin of its frame, to the right and up to the upper
    edge of the cell.
    """
    x = (col + 0.25 + 0.5 * (quarter % 2)) * fine
    y = (row - 0.25 - 0.5 * (quarter // 2)) * fine
    rx, ry, rz = rotated(T_window_patch, x, y, z)
    # A rotation error (wx, wy, wz) of the frame raises the point by wx ry - wy rx.
    variance = (
        covariance[2, 2]
        + ry * ry * covariance[3, 3]
        + rx * rx * covariance[4, 4]
        + 2.0 * (ry * covariance[2, 3] - rx * covariance[2, 4] - rx * ry * covariance[3, 4])
    )
    return (
        top - 1 - math.floor((ry + T_window_patch[1, 3]) / coarse),
        math.floor((rx + T_window_patch[0, 3]) / coarse) - left,
        rx + T_window_patch[0, 3],
        ry + T_window_patch[1, 3],
        rz + T_window_patch[2, 3],
        max(variance, 0.0),
    )


@njit(cache=True, nogil=True)
def pool_resampled(
    layers: tuple[Single, ...],
    t1: int,
    fine: float,
    left: int,
    top: int,
    T_window_patch: Float,
    covariance: Float,
    coarse: float,
    window_left: int,
    window_top: int,
    cells: CellArrays,
    sums: Float,
) -> None:  # pragma: no cover - compiled
    """Pool a patch in another frame, or with cells that do not fit those of the window, as ``pool_layers``.

    Each cell is divided into 2 x 2 parts with a quarter of its heights each; a part is added to the cell of
    the window that contains the transformed centre of the part. Cells no larger than the window's leave no
    holes: the centres are at most 0.36 of a cell from any point, less than half a cell. The ``covariance``
    (6, 6) of ``T_window_patch``, in the window's frame, is added to the variance of each height. It is also
    added to the variance due to the poses, since it is an error common to all heights.
    """
    means, variances, lows, highs, counts, ages, poses, intensities, first_ages, overhangs = layers
    rows, cols = cells[0].shape
    area = min(fine * fine / (coarse * coarse), 1.0)
    for r in range(means.shape[0]):
        for c in range(means.shape[1]):
            n, z = np.float64(counts[r, c]), np.float64(means[r, c])
            if not (n > 0.0 and math.isfinite(z)):
                continue
            age = np.float64(ages[r, c])
            stamp = t1 - math.floor(age * 1e9 + 0.5) if math.isfinite(age) else t1
            vertical_scale = T_window_patch[2, 2]
            variance = np.float64(variances[r, c]) * vertical_scale * vertical_scale
            low, high = (
                (np.float64(lows[r, c]) - z) * vertical_scale,
                (np.float64(highs[r, c]) - z) * vertical_scale,
            )
            for quarter in range(4):
                row, col, x, y, height, pose_variance = target_cell(
                    quarter,
                    left + c,
                    top - r,
                    z,
                    fine,
                    T_window_patch,
                    covariance,
                    coarse,
                    window_left,
                    window_top,
                )
                if 0 <= row < rows and 0 <= col < cols:
                    m2 = 0.25 * n * (variance + pose_variance)
                    _pool(row, col, 0.25 * n, height, m2, height + low, height + high, stamp, cells)
                    if len(sums):
                        first_us = first_us_of(t1, np.float64(first_ages[r, c]))
                        pose = np.float64(poses[r, c]) * vertical_scale * vertical_scale + pose_variance
                        overhang = height + (np.float64(overhangs[r, c]) - z) * vertical_scale
                        intensity = np.float64(intensities[r, c])
                        squares = 0.25 * n * n  # the four parts are one cluster
                        part = 0.25 * n
                        pool_auxiliary(
                            sums, row, col, part, x, y, squares, area, pose, intensity, first_us, overhang
                        )


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
def flag_disagreement(
    count: Float, m2: Float, within: Float, sigmas: float, agreed_m: float, out: Flags
) -> int:  # pragma: no cover - compiled
    """Flag cells whose standard deviation between patches exceeds ``agreed_m`` and ``sigmas`` times that
    within.
    """
    flagged_count = 0
    for i in range(len(count)):
        between = m2[i] - within[i]
        if between > sigmas * sigmas * within[i] + agreed_m * agreed_m * count[i] and count[i] > 0.0:
            out[i] = True
            flagged_count += 1
    return flagged_count


@njit(cache=True, nogil=True)
def pool_blocks(
    source: tuple[Float, Float, Float, Float, Float, Int],
    factor: int,
    down: int,
    right: int,
    cells: CellArrays,
) -> None:  # pragma: no cover - compiled
    """Pool statistics ``(rows, cols)`` into coarser ones; see ``pool_layers``."""
    counts, means, squares, lows, highs, stamps = source
    rows, cols = counts.shape
    for r in range(rows):
        for c in range(cols):
            if counts[r, c] > 0.0:
                _pool(
                    (r + down) // factor,
                    (c + right) // factor,
                    counts[r, c],
                    means[r, c],
                    squares[r, c],
                    lows[r, c],
                    highs[r, c],
                    stamps[r, c],
                    cells,
                )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over the further layers of an elevation map; ``further_layers`` and ``mosaic`` check the arguments."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from cdff_common.raster._kernels import Float, Int, Single, landing

#: ``first_ns`` of a cell without measurement, and of one whose oldest measurement is not known.
NEVER_FIRST_NS = np.iinfo(np.int64).max
UNKNOWN_FIRST_NS = np.iinfo(np.int64).min


# The update of a cell is written out in both loops: called with its five arrays it takes six times as long.


@njit(cache=True, nogil=True, inline="always")
def _stamp(t1: int, age_s: float) -> Any:  # pragma: no cover - compiled
    """When the oldest height was measured."""
    return t1 - np.int64(math.floor(age_s * 1e9 + 0.5)) if math.isfinite(age_s) else np.int64(UNKNOWN_FIRST_NS)


@njit(cache=True, nogil=True)
def pool_further(
    layers: tuple[Single, ...], t1: int, factor: int, down: int, right: int,
    pose_m2: Float, bright: Float, lit: Float, first: Int, over: Float,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """As ``_kernels.pool_layers``, for those that follow the six: pose_variance, intensity, first_age_s, overhang_m.

    A pose_variance of NaN makes the cell's unknown, and so does a first_age_s.
    """
    means, _, _, _, counts, _, poses, intensities, ages, overhangs = layers
    rows, cols = means.shape
    for r in range(max(0, -down), min(rows, lit.shape[0] * factor - down)):
        row = (r + down) // factor
        for c in range(max(0, -right), min(cols, lit.shape[1] * factor - right)):
            n, brightness = np.float64(counts[r, c]), np.float64(intensities[r, c])
            if not (n > 0.0 and math.isfinite(means[r, c])):
                continue
            col = (c + right) // factor
            first_ns, overhang = _stamp(t1, np.float64(ages[r, c])), np.float64(overhangs[r, c])
            pose_m2[row, col] += n * np.float64(poses[r, c])
            if math.isfinite(brightness):
                bright[row, col] += n * brightness
                lit[row, col] += n
            if first_ns < first[row, col]:
                first[row, col] = first_ns
            if overhang < over[row, col]:
                over[row, col] = overhang


@njit(cache=True, nogil=True)
def pool_further_moved(
    layers: tuple[Single, ...], t1: int, fine: float, left: int, top: int, T: Float,
    covariance: Float, coarse: float, window_left: int, window_top: int,
    pose_m2: Float, bright: Float, lit: Float, first: Int, over: Float,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """As ``_kernels.pool_moved``: what the frame's covariance adds to the heights is common to them, as a pose's is."""
    means, _, _, _, counts, _, poses, intensities, ages, overhangs = layers
    steep = T[2, 2]
    for r in range(means.shape[0]):
        for c in range(means.shape[1]):
            n, z, brightness = np.float64(counts[r, c]), np.float64(means[r, c]), np.float64(intensities[r, c])
            if not (n > 0.0 and math.isfinite(z)):
                continue
            first_ns = _stamp(t1, np.float64(ages[r, c]))
            pose = np.float64(poses[r, c]) * steep * steep
            above = (np.float64(overhangs[r, c]) - z) * steep
            for part in range(4):
                row, col, height, spread = landing(
                    part, left + c, top - r, z, fine, T, covariance, coarse, window_left, window_top
                )
                if not (0 <= row < lit.shape[0] and 0 <= col < lit.shape[1]):
                    continue
                pose_m2[row, col] += 0.25 * n * (pose + spread)
                if math.isfinite(brightness):
                    bright[row, col] += 0.25 * n * brightness
                    lit[row, col] += 0.25 * n
                if first_ns < first[row, col]:
                    first[row, col] = first_ns
                if height + above < over[row, col]:
                    over[row, col] = height + above


@njit(cache=True, nogil=True)
def relief(count: Float, mean: Float, out: Float) -> int:  # pragma: no cover - compiled
    """Fill ``(rows, cols)`` with the mean squared difference to the observed neighbours, NaN where there is none.

    Returns
    -------
    alone : int
        Observed cells without an observed neighbour.
    """
    rows, cols = count.shape
    alone = 0
    for r in range(rows):
        for c in range(cols):
            out[r, c] = np.nan
            if not count[r, c] > 0.0:
                continue
            z, squares, pairs = mean[r, c], 0.0, 0
            if r > 0 and count[r - 1, c] > 0.0:
                squares += (z - mean[r - 1, c]) * (z - mean[r - 1, c])
                pairs += 1
            if r < rows - 1 and count[r + 1, c] > 0.0:
                squares += (z - mean[r + 1, c]) * (z - mean[r + 1, c])
                pairs += 1
            if c > 0 and count[r, c - 1] > 0.0:
                squares += (z - mean[r, c - 1]) * (z - mean[r, c - 1])
                pairs += 1
            if c < cols - 1 and count[r, c + 1] > 0.0:
                squares += (z - mean[r, c + 1]) * (z - mean[r, c + 1])
                pairs += 1
            if pairs:
                out[r, c] = squares / pairs
            else:
                alone += 1
    return alone


@njit(cache=True, nogil=True)
def fill_further(
    count: Float, mean: Float, m2: Float, pose_m2: Float, bright: Float, lit: Float, first: Int, over: Float,
    squares: Float, typical: float, t1: int, out: Single,
) -> None:  # pragma: no cover - compiled  # fmt: skip
    """Fill ``(5, cells)`` layers pose_variance, error_variance, first_age_s, intensity, overhang_m from flat sums.

    What patches that contradict one another leave of an overhang below the ground is none.
    ``squares`` are those of ``relief``, ``typical`` stands for them in cells without neighbours.
    """
    for i in range(len(count)):
        n = count[i]
        for k in range(5):
            out[k, i] = np.nan
        if n > 0.0:
            pose = pose_m2[i] / n
            # Over a cell of edge r a slope s has the variance (s r)^2 / 12 along each axis; neighbours differ by s r.
            ground = (typical if math.isnan(squares[i]) else squares[i]) * (2.0 / 12.0)
            own = max(m2[i] / n - pose, 0.0) + ground
            out[0, i], out[1, i] = pose, pose + own / max(n, 1.0)
            if first[i] != NEVER_FIRST_NS and first[i] != UNKNOWN_FIRST_NS:
                out[2, i] = (t1 - first[i]) * 1e-9
        if lit[i] > 0.0:
            out[3, i] = bright[i] / lit[i]
        if math.isfinite(over[i]) and not over[i] <= mean[i]:
            out[4, i] = over[i]

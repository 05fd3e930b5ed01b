# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of MatchedFilter."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import ByteArray, Float32Array, FloatArray, IntArray
from cdff_core.point_sources.regions import COLUMNS, grow


@njit(cache=True)
def local_maxima(
    filtered: Float32Array, noise: Float32Array, threshold: float, gain: float, limit: int
) -> tuple[IntArray, FloatArray, int]:
    """Return pixels ``(n, 2)`` (row, column) and signal-to-noise ratios of the maxima of 3 x 3 pixels.

    ``gain`` is the standard deviation of the filtered image for a noise of one. The third value is the
    number of
    all maxima; at most ``limit`` are returned.
    """
    rows, cols = filtered.shape
    pixels, snr = np.empty((limit, 2), np.int64), np.empty(limit)
    count = 0
    limit_of_noise = np.float32(threshold * gain)
    for r in range(1, rows - 1):
        for c in range(1, cols - 1):
            value = filtered[r, c]
            if value <= limit_of_noise * noise[r, c]:
                continue
            # Of equal neighbours, only the first in reading order is a maximum.
            if (
                value >= filtered[r, c + 1]
                and value > filtered[r, c - 1]
                and value >= filtered[r + 1, c - 1]
                and value >= filtered[r + 1, c]
                and value >= filtered[r + 1, c + 1]
                and value > filtered[r - 1, c - 1]
                and value > filtered[r - 1, c]
                and value > filtered[r - 1, c + 1]
            ):
                if count < limit:
                    pixels[count, 0], pixels[count, 1] = r, c
                    snr[count] = value / (gain * noise[r, c])
                count += 1
    returned_count = min(count, limit)
    return pixels[:returned_count], snr[:returned_count], count


@njit(cache=True)
def measure_regions(
    residual: Float32Array,
    noise: Float32Array,
    mask: ByteArray,
    pixels: IntArray,
    snr: FloatArray,
    bright_snr: float,
    threshold: float,
    labels: NDArray[np.int32],
) -> tuple[FloatArray, IntArray]:
    """Return the regions ``(n, 11)`` around bright maxima and the maximum that represents each one.

    The maxima are sorted by brightness. A maximum within the region of a brighter one belongs to that;
    faint ones
    outside are their own representatives, without a region. Saturated pixels count as bright.
    """
    n, rows, cols = len(pixels), residual.shape[0], residual.shape[1]
    regions, owner = np.zeros((n, COLUMNS)), np.empty(n, np.int64)
    stack = np.empty(32 * (rows + cols), np.int64)
    for i in range(n):
        r, c = pixels[i]
        owner[i] = i
        if labels[r, c] > 0:
            owner[i] = labels[r, c] - 1
        elif snr[i] >= bright_snr and residual[r, c] > threshold * noise[r, c]:
            regions[i] = grow(residual, noise, labels, i + 1, r, c, threshold, stack)
    return regions, owner

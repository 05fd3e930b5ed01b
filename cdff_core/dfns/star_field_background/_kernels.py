# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of TileMedian."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import ByteArray, Float32Array, FloatArray
from cdff_core.point_sources.regions import AREA, FIRST_U, FIRST_V, LAST_U, LAST_V, UU, UV, VV, grow

#: Correction of a standard deviation of values within three standard deviations, of a normal distribution.
_CLIPPED = 1.0 / 0.98658


@njit(cache=True)
def tile_statistics(
    image: Float32Array, rows: int, cols: int, height: int, width: int, step: int
) -> FloatArray:
    """Return median and clipped standard deviation ``(2, rows, cols)`` of tiles of ``height`` x ``width``
    pixels.

    Every ``step``-th pixel of a tile is used; the deviation is that of the values within three of its own, so
    that sources and the steps of the digitisation do not matter.
    """
    result = np.zeros((2, rows, cols))
    values = np.empty((height // step + 1) * (width // step + 1))
    for i in range(rows):
        for j in range(cols):
            n = 0
            for r in range(i * height, (i + 1) * height, step):
                for c in range(j * width, (j + 1) * width, step):
                    values[n] = image[r, c]
                    n += 1
            ordered = np.sort(values[:n])
            centre = 0.5 * (ordered[n // 2] + ordered[(n - 1) // 2])
            sigma = centre - ordered[int(0.1587 * n)]
            sigma = max(sigma, 1e-6)
            # Twice: the quantile has the resolution of the digitisation only.
            for _ in range(2):
                total, squares, used = 0.0, 0.0, 0
                for k in range(n):
                    d = ordered[k] - centre
                    if abs(d) <= 3.0 * sigma:
                        total += d
                        squares += d * d
                        used += 1
                if used > 2:
                    mean = total / used
                    sigma = max(np.sqrt(max(squares / used - mean * mean, 0.0)) * _CLIPPED, 1e-6)
            result[0, i, j], result[1, i, j] = centre, sigma
    return result


@njit(cache=True)
def mark_trails(
    residual: Float32Array, noise: Float32Array, mask: ByteArray, threshold: float, length: float, value: int
) -> int:
    """Set the pixels of long thin regions of ``mask`` to ``value``; return the number of trails.

    A trail is a region above ``threshold`` standard deviations that is longer than ``length`` pixels and at
    least eight times as long as wide (second moments).
    """
    rows, cols = residual.shape
    labels = np.zeros((rows, cols), np.int32)
    stack = np.empty(32 * max(rows, cols), np.int64)
    label, trails = 0, 0
    # Every second row and column suffices: a trail is longer than two pixels.
    for r in range(0, rows, 2):
        for c in range(0, cols, 2):
            if labels[r, c] != 0 or residual[r, c] <= threshold * noise[r, c]:
                continue
            label += 1
            region = grow(residual, noise, labels, label, r, c, threshold, stack)
            if max(region[LAST_U] - region[FIRST_U], region[LAST_V] - region[FIRST_V]) < length:
                continue
            half, difference = 0.5 * (region[UU] + region[VV]), 0.5 * (region[UU] - region[VV])
            root = np.sqrt(difference * difference + region[UV] * region[UV])
            if half + root < 64.0 * max(half - root, 0.05) or region[AREA] < length:
                continue
            trails += 1
            for y in range(int(region[FIRST_V]), int(region[LAST_V]) + 1):
                for x in range(int(region[FIRST_U]), int(region[LAST_U]) + 1):
                    if labels[y, x] == label:
                        for dy in range(-3, 4):
                            for dx in range(-3, 4):
                                if 0 <= y + dy < rows and 0 <= x + dx < cols:
                                    mask[y + dy, x + dx] = value
    return trails

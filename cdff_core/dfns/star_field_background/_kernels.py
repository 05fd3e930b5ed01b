# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of TileMedian."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import ByteArray, Float32Array, FloatArray
from cdff_core.point_sources.regions import AREA, FIRST_U, FIRST_V, LAST_U, LAST_V, UU, UV, VV, grow

#: Correction of a standard deviation of values within three standard deviations, of a normal distribution.
_CLIPPED = 1.0 / 0.98658


@njit(cache=True)
def ordered_statistics(ordered: Float32Array) -> FloatArray:
    """Return median and clipped standard deviation ``(2, n)`` of rows ``(n, m)`` of ascending values.

    The deviation is that of the values within three of its own, so that sources and the steps of the
    digitisation do not matter.
    """
    count, n = ordered.shape
    result = np.zeros((2, count))
    for i in range(count):
        values = ordered[i].astype(np.float64)
        centre = 0.5 * (values[n // 2] + values[(n - 1) // 2])
        sigma = max(centre - values[int(0.1587 * n)], 1e-6)
        # Twice: the quantile has the resolution of the digitisation only.
        for _ in range(2):
            total, squares, retained_count = 0.0, 0.0, 0
            for k in range(n):
                d = values[k] - centre
                if abs(d) <= 3.0 * sigma:
                    total += d
                    squares += d * d
                    retained_count += 1
            if retained_count > 2:
                mean = total / retained_count
                sigma = max(np.sqrt(max(squares / retained_count - mean * mean, 0.0)) * _CLIPPED, 1e-6)
        result[0, i], result[1, i] = centre, sigma
    return result


@njit(cache=True)
def _interpolate(tiles: FloatArray, position: float, side: int, line: Float32Array) -> None:
    """Set ``line`` to one image row of values that are linear between the centres of tiles.

    ``tiles`` has a border of one tile before and two after the image; ``position`` is the row in tiles.
    """
    i = int(position)
    weight = position - i
    cols = len(line)
    first, j = 0, 0
    while first < cols:
        # Columns between the centres of the tiles j and j + 1: column c lies at (c + 1/2) / side + 1/2.
        following = min(int(np.ceil((j + 0.5) * side - 0.5)), cols)
        before = (1.0 - weight) * tiles[i, j] + weight * tiles[i + 1, j]
        after = (1.0 - weight) * tiles[i, j + 1] + weight * tiles[i + 1, j + 1]
        slope = (after - before) / side
        start = np.float32(before + slope * (first + 0.5 + (0.5 - j) * side))
        step = np.float32(slope)
        part = line[first:following]
        for k in range(len(part)):
            part[k] = start + np.float32(k) * step
        first = following
        j += 1


@njit(cache=True)
def subtract_background(
    image: Float32Array,
    levels: FloatArray,
    sigmas: FloatArray,
    height: int,
    width: int,
    residual: Float32Array,
    noise: Float32Array,
) -> None:
    """Set ``residual`` to the image without its background, and ``noise`` to its standard deviation.

    ``levels`` and ``sigmas`` are those of tiles of ``height`` x ``width`` pixels, with a border of one tile
    before and two after the image.
    """
    rows, cols = image.shape
    line = np.empty(cols, np.float32)
    for r in range(rows):
        position = (r + 0.5) / height + 0.5
        _interpolate(levels, position, width, line)
        for c in range(cols):
            residual[r, c] = image[r, c] - line[c]
        _interpolate(sigmas, position, width, noise[r])


@njit(cache=True)
def mark_trails(
    residual: Float32Array,
    noise: Float32Array,
    mask: ByteArray,
    labels: NDArray[np.int32],
    threshold: float,
    length: float,
    value: int,
) -> int:
    """Set the pixels of long thin regions of ``mask`` to ``value``; return the number of trails.

    ``labels`` is memory for the numbers of the regions, all zero.

    A trail is a region above ``threshold`` standard deviations that is longer than ``length`` pixels and at
    least eight times as long as wide (second moments).
    """
    rows, cols = residual.shape
    stack = np.empty(32 * max(rows, cols), np.int64)
    label, trails = 0, 0
    # Every second row and column suffices: a trail is longer than two pixels.
    for r in range(0, rows, 2):
        for c in range(0, cols, 2):
            if residual[r, c] <= threshold * noise[r, c] or labels[r, c] != 0:
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

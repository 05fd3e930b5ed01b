# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of MutualRatio: the two nearest descriptors of each point, in one pass over the pairs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, ByteArray, Float32Array, IntArray

#: Distance of a point without any candidate.
EXCLUDED = np.float32(1e12)


class Neighbours(NamedTuple):
    """Nearest neighbours of n source points and m sink points; the kernels update the arrays."""

    sink: IntArray  # (n,), nearest sink of each source
    sink_distances2: Float32Array  # (n, 2), squared (or Hamming) distances of nearest and second nearest sink
    source: IntArray  # (m,), nearest source of each sink
    source_distances2: Float32Array  # (m,), its distance


@njit(cache=True)
def update_nearest(block: Float32Array, start: int, neighbours: Neighbours) -> None:
    """Update the nearest neighbours by distances ``(k, m)`` of the source rows ``start`` to ``start + k``."""
    nearest_sink, distances2 = neighbours.sink, neighbours.sink_distances2
    nearest_source, source_distances2 = neighbours.source, neighbours.source_distances2
    for k in range(block.shape[0]):
        i = start + k
        nearest2, second2, nearest = distances2[i, 0], distances2[i, 1], nearest_sink[i]
        for j in range(block.shape[1]):
            distance2 = block[k, j]
            if distance2 < second2:
                if distance2 < nearest2:
                    second2, nearest2, nearest = nearest2, distance2, j
                else:
                    second2 = distance2
            if distance2 < source_distances2[j]:
                source_distances2[j], nearest_source[j] = distance2, i
        distances2[i, 0], distances2[i, 1], nearest_sink[i] = nearest2, second2, nearest


@njit(cache=True)
def search_along_lines(
    source: ByteArray,
    sink: ByteArray,
    lines: Float32Array,
    points: Float32Array,
    band_px: float,
    is_hamming: bool,
    neighbours: Neighbours,
) -> None:
    """Update the nearest neighbours by the pairs whose Sampson distance is at most ``band_px``.

    ``lines`` ``(n, 4)``: coefficients of each epipolar line in the sink image, and the squared norm of the
    first two. ``points`` ``(3, m)``: x and y of each sink point, and that squared norm of its line in the
    source image.
    """
    nearest_sink, distances2 = neighbours.sink, neighbours.sink_distances2
    nearest_source, source_distances2 = neighbours.source, neighbours.source_distances2
    bit_counts = np.zeros(256, np.int64)
    for value in range(256):
        bit_counts[value] = (value & 1) + bit_counts[value >> 1]
    is_near = np.zeros(points.shape[1], np.bool_)
    for i in range(len(source)):
        _mark_near(lines[i], points[0], points[1], points[2], band_px**2, is_near)
        for j in range(len(is_near)):
            if not is_near[j]:
                continue
            total = 0
            if is_hamming:
                for c in range(source.shape[1]):
                    total += bit_counts[source[i, c] ^ sink[j, c]]
            else:
                for c in range(source.shape[1]):
                    difference = np.int32(source[i, c]) - np.int32(sink[j, c])
                    total += int(difference * difference)
            distance2 = np.float32(total)
            if distance2 < distances2[i, 0]:
                distances2[i, 1], distances2[i, 0], nearest_sink[i] = distances2[i, 0], distance2, j
            elif distance2 < distances2[i, 1]:
                distances2[i, 1] = distance2
            if distance2 < source_distances2[j]:
                source_distances2[j], nearest_source[j] = distance2, i


@njit(cache=True)
def _mark_near(
    line: Float32Array,
    x: Float32Array,
    y: Float32Array,
    gradients2: Float32Array,
    band2: float,
    is_near: BoolArray,
) -> None:
    """Set which points have a Sampson distance of at most the square root of ``band2`` from the line."""
    a, b, c, gradient2 = line
    for j in range(len(is_near)):
        error = a * x[j] + b * y[j] + c
        is_near[j] = error * error <= np.float32(band2) * (gradient2 + gradients2[j])

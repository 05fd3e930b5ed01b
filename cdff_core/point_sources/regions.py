# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled flood fill: extent and moments of the light of connected pixels."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import Float32Array, FloatArray, IntArray

#: Columns of the result of ``grow``: pixels, first and last column and row, light, its first and second
#: moments.
AREA, FIRST_U, LAST_U, FIRST_V, LAST_V, LIGHT, MEAN_U, MEAN_V, UU, UV, VV = range(11)
#: Number of these columns.
COLUMNS = 11


@njit(cache=True)
def grow(
    residual: Float32Array,
    noise: Float32Array,
    labels: NDArray[np.int32],
    label: int,
    row: int,
    col: int,
    threshold: float,
    stack: IntArray,
) -> FloatArray:
    """Label the connected pixels above ``threshold`` standard deviations around a pixel and measure them.

    Parameters
    ----------
    residual, noise : ndarray (r, c)
        Image without background and the standard deviation of its noise, DN.
    labels : ndarray of int32 (r, c)
        0 for free pixels; the pixels of the region are set to ``label``.
    stack : ndarray of int64 (m,)
        Memory for the pixels to visit; the region ends when it is full.

    Returns
    -------
    ndarray (11,)
        The columns named in this module; second moments are central, square pixels.
    """
    rows, cols = residual.shape
    out = np.zeros(COLUMNS)
    out[FIRST_U], out[FIRST_V] = cols, rows
    stack[0] = row * cols + col
    labels[row, col] = label
    size = 1
    while size > 0:
        size -= 1
        r, c = stack[size] // cols, stack[size] % cols
        light = float(residual[r, c])
        out[AREA] += 1.0
        out[FIRST_U], out[LAST_U] = min(out[FIRST_U], c), max(out[LAST_U], c)
        out[FIRST_V], out[LAST_V] = min(out[FIRST_V], r), max(out[LAST_V], r)
        out[LIGHT] += light
        u, v = c - col, r - row
        out[MEAN_U] += light * u
        out[MEAN_V] += light * v
        out[UU] += light * u * u
        out[UV] += light * u * v
        out[VV] += light * v * v
        for dr in range(-1, 2):
            for dc in range(-1, 2):
                y, x = r + dr, c + dc
                if y < 0 or x < 0 or y >= rows or x >= cols or labels[y, x] != 0 or size >= len(stack):
                    continue
                if residual[y, x] > threshold * noise[y, x]:
                    labels[y, x] = label
                    stack[size] = y * cols + x
                    size += 1
    if out[LIGHT] > 0.0:
        mean_u, mean_v = out[MEAN_U] / out[LIGHT], out[MEAN_V] / out[LIGHT]
        out[UU] = out[UU] / out[LIGHT] - mean_u * mean_u
        out[UV] = out[UV] / out[LIGHT] - mean_u * mean_v
        out[VV] = out[VV] / out[LIGHT] - mean_v * mean_v
        out[MEAN_U], out[MEAN_V] = col + mean_u, row + mean_v
    return out

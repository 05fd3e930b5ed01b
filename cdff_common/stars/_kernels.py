# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop over the pixels of point sources; ``image.add_sources`` checks the arguments."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Single = NDArray[np.float32]


@njit(cache=True, nogil=True)
def add_trails(
    image: Single, pixels: Float, trails: Float, signals: Float, sigma_px: float, radius_px: float
) -> None:  # pragma: no cover - compiled
    """Add sources to an image ``(rows, cols)`` in place.

    Each moves along a straight line with the centre ``(n, 2)`` and the displacement ``(n, 2)``. The line is
    summed over points at most half a standard deviation apart; each point is integrated over the pixels.
    """
    rows, cols = image.shape
    scale = 1.0 / (math.sqrt(2.0) * sigma_px)
    reach = math.ceil(radius_px)
    horizontal = np.empty(2 * reach + 3)
    for i in range(len(pixels)):
        length = math.hypot(trails[i, 0], trails[i, 1])
        steps = math.ceil(2.0 * length / sigma_px) + 1
        share = signals[i] / steps
        for k in range(steps):
            fraction = (k + 0.5) / steps - 0.5
            u = pixels[i, 0] + fraction * trails[i, 0]
            v = pixels[i, 1] + fraction * trails[i, 1]
            left = max(math.floor(u + 0.5) - reach, 0)
            right = min(math.floor(u + 0.5) + reach + 1, cols)
            top = max(math.floor(v + 0.5) - reach, 0)
            bottom = min(math.floor(v + 0.5) + reach + 1, rows)
            if left >= right or top >= bottom:
                continue
            edge = math.erf((left - 0.5 - u) * scale)
            for c in range(left, right):
                following = math.erf((c + 0.5 - u) * scale)
                horizontal[c - left] = 0.5 * (following - edge)
                edge = following
            edge = math.erf((top - 0.5 - v) * scale)
            for r in range(top, bottom):
                following = math.erf((r + 0.5 - v) * scale)
                row_share = share * 0.5 * (following - edge)
                edge = following
                for c in range(left, right):
                    image[r, c] += np.float32(row_share * horizontal[c - left])

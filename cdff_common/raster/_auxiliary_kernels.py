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
)


@njit(cache=True, nogil=True, inline="always")
def pool_auxiliary(
    sums: FloatArray,
    row: int,
    col: int,
    n: float,
    squares: float,
    area: float,
    pose: float,
    intensity: float,
    first_us: float,
    overhang: float,
) -> None:  # pragma: no cover - compiled
    """Add ``n`` heights of a map's cell, which covers the fraction ``area``, to a cell of the window.

    ``squares`` is added to the sum of the squared numbers of heights. A NaN in ``pose`` makes that of the
    cell unknown.
    """
    sums[row, col, COUNT_SQUARES] += squares
    sums[row, col, AREA_SUM] += n * area
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
def fill_auxiliary(
    count: FloatArray,
    mean: FloatArray,
    m2: FloatArray,
    sums: FloatArray,
    squares: FloatArray,
    typical: float,
    t1_us: float,
    out: Float32Array,
) -> tuple[bool, bool]:  # pragma: no cover - compiled
    """Fill ``(5, cells)`` layers pose_variance, error_variance, first_age_s, intensity, overhang_m.

    Returns whether any cell has an intensity and whether any has an overhang. Overhangs below the ground,
    which conflicting patches can produce, are discarded. ``squares`` is the output of ``relief``; ``typical``
    replaces it in cells without neighbours.
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
            out[0, i], out[1, i] = pose, pose + spread
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

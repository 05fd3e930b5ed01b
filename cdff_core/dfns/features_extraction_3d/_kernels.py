# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of the keypoint detectors that compare the salience of points.

The neighbours of point i are ``index[start[i]:start[i + 1]]``.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, FloatArray, IntArray


@njit(cache=True)
def weighted_scatters(
    points: FloatArray, start: IntArray, index: IntArray
) -> FloatArray:  # pragma: no cover - compiled
    """Return the scatter (n, 3, 3) of the neighbours about each point.

    The weight of a neighbour is the inverse of its own number of neighbours.
    """
    out = np.zeros((len(points), 3, 3))
    for i in range(len(points)):
        total = 0.0
        for j in index[start[i] : start[i + 1]]:
            if j == i:
                continue
            weight = 1.0 / (start[j + 1] - start[j])
            total += weight
            for a in range(3):
                for b in range(a + 1):
                    out[i, a, b] += weight * (points[j, a] - points[i, a]) * (points[j, b] - points[i, b])
        for a in range(3):
            for b in range(a + 1):
                if total > 0.0:
                    out[i, a, b] /= total
                out[i, b, a] = out[i, a, b]
    return out


@njit(cache=True)
def are_local_maxima(
    salience: FloatArray, candidates: IntArray, start: IntArray, index: IntArray
) -> BoolArray:  # pragma: no cover - compiled
    """Return which candidates (k,) are more salient than their neighbours; of equally salient ones the first.

    ``start`` and ``index`` are the neighbours of the candidates.
    """
    out = np.ones(len(candidates), np.bool_)
    for k in range(len(candidates)):
        i = candidates[k]
        for j in index[start[k] : start[k + 1]]:
            if salience[j] > salience[i] or (salience[j] == salience[i] and j < i):
                out[k] = False
                break
    return out


@njit(cache=True)
def normal_scatters(
    normals: FloatArray, start: IntArray, index: IntArray
) -> FloatArray:  # pragma: no cover - compiled
    """Return the mean outer product of the normals of each neighbourhood, (n, 3, 3)."""
    out = np.zeros((len(start) - 1, 3, 3))
    for i in range(len(out)):
        for j in index[start[i] : start[i + 1]]:
            for a in range(3):
                for b in range(3):
                    out[i, a, b] += normals[j, a] * normals[j, b]
        out[i] /= max(start[i + 1] - start[i], 1)
    return out

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops of ISS."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]


@njit(cache=True)
def scatters(points: Float, start: Int, index: Int) -> Float:  # pragma: no cover - compiled
    """Scatter about each point (n, 3, 3), neighbours weighted by the inverse of their own number of neighbours."""
    out = np.zeros((len(points), 3, 3))
    for i in range(len(points)):
        total = 0.0
        for j in index[start[i] : start[i + 1]]:
            if j == i:
                continue
            w = 1.0 / (start[j + 1] - start[j])
            total += w
            for a in range(3):
                for b in range(a + 1):
                    out[i, a, b] += w * (points[j, a] - points[i, a]) * (points[j, b] - points[i, b])
        for a in range(3):
            for b in range(a + 1):
                if total > 0.0:
                    out[i, a, b] /= total
                out[i, b, a] = out[i, a, b]
    return out


@njit(cache=True)
def greatest_around(
    salience: Float, which: Int, start: Int, index: Int
) -> NDArray[np.bool_]:  # pragma: no cover - compiled
    """Whether each point of ``which`` is the most salient of its neighbours; of equal ones the first row is."""
    out = np.ones(len(which), np.bool_)
    for k in range(len(which)):
        i = which[k]
        for j in index[start[k] : start[k + 1]]:
            if salience[j] > salience[i] or (salience[j] == salience[i] and j < i):
                out[k] = False
                break
    return out

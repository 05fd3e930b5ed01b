# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop of Harris' detector on surfaces."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Int = NDArray[np.int64]


@njit(cache=True)
def normal_scatters(normals: Float, start: Int, index: Int) -> Float:  # pragma: no cover - compiled
    """Mean outer product of the normals of each neighbourhood, (n, 3, 3); the side of a normal does not matter."""
    out = np.zeros((len(start) - 1, 3, 3))
    for i in range(len(out)):
        for j in index[start[i] : start[i + 1]]:
            for a in range(3):
                for b in range(3):
                    out[i, a, b] += normals[j, a] * normals[j, b]
        out[i] /= max(start[i + 1] - start[i], 1)
    return out

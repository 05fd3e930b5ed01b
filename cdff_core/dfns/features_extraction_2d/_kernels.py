# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop of AdaptiveFast."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, IntArray


@njit(cache=True)
def suppress(columns: IntArray, rows: IntArray, shape: tuple[int, int], radius: int) -> BoolArray:
    """Return which points remain when each, in order, suppresses a square of ``radius`` around it."""
    cell = max(radius // 2, 1)
    covered = np.zeros((shape[0] // cell + 1, shape[1] // cell + 1), np.bool_)
    reach = radius // cell
    kept = np.zeros(len(columns), np.bool_)
    for i in range(len(columns)):
        r, c = rows[i] // cell, columns[i] // cell
        if covered[r, c]:
            continue
        kept[i] = True
        covered[
            max(r - reach, 0) : min(r + reach + 1, covered.shape[0]),
            max(c - reach, 0) : min(c + reach + 1, covered.shape[1]),
        ] = True
    return kept

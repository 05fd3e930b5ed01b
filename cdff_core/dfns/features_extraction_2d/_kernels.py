# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop of AdaptiveFast: non-maximum suppression."""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import BoolArray, IntArray


@njit(cache=True)
def suppress(columns: IntArray, rows: IntArray, shape: tuple[int, int], radius: int) -> BoolArray:
    """Return which points remain if each one, in order, suppresses later ones in a square around it.

    ``radius`` is the half width of the square in pixels; positions are rounded to cells of half of it.
    """
    cell_px = max(radius // 2, 1)
    is_covered = np.zeros((shape[0] // cell_px + 1, shape[1] // cell_px + 1), np.bool_)
    reach_cells = radius // cell_px
    is_kept = np.zeros(len(columns), np.bool_)
    for i in range(len(columns)):
        r, c = rows[i] // cell_px, columns[i] // cell_px
        if is_covered[r, c]:
            continue
        is_kept[i] = True
        is_covered[
            max(r - reach_cells, 0) : min(r + reach_cells + 1, is_covered.shape[0]),
            max(c - reach_cells, 0) : min(c + reach_cells + 1, is_covered.shape[1]),
        ] = True
    return is_kept

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loop of blooming: charge above the full well moves along the columns of a detector."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Single = NDArray[np.float32]


@njit(cache=True, nogil=True)
def bloom(charge: Single, full_well_e: float) -> None:  # pragma: no cover - compiled
    """Move half of the excess charge ``(rows, columns)`` of each pixel up and half down, in place."""
    rows, columns = charge.shape
    for column in range(columns):
        has_excess = False
        for row in range(rows):
            if charge[row, column] > full_well_e:
                has_excess = True
                break
        if not has_excess:
            continue
        up = np.zeros(rows)
        carried = 0.0
        for row in range(rows):
            excess = max(charge[row, column] - full_well_e, 0.0)
            up[row] = 0.5 * excess
            level = min(charge[row, column], full_well_e) + carried
            carried = max(level - full_well_e, 0.0) + 0.5 * excess
            charge[row, column] = min(level, full_well_e)
        carried = 0.0
        for i in range(rows):
            row = rows - 1 - i
            level = charge[row, column] + carried
            carried = max(level - full_well_e, 0.0) + up[row]
            charge[row, column] = min(level, full_well_e)

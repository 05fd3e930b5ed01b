# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Grid of the nearest surface point: a search for the nearest point in constant time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.arrays import FloatArray
from cdff_common.geometry.kdtree import kd_tree, nearest

#: Width of the border around the points, in diameters.
_BORDER = 0.15


class NearestGrid(NamedTuple):
    """Grid of the row of the point that is nearest to the centre of each cell.

    Attributes
    ----------
    rows : ndarray of int32, shape (nx, ny, nz)
    low_m : ndarray, shape (3,)
        Corner of cell (0, 0, 0).
    cell_m : float
    """

    rows: NDArray[np.int32]
    low_m: FloatArray
    cell_m: float


def nearest_grid(points_m: FloatArray, cells: int) -> NearestGrid:
    """Return the grid of points (n, 3) with ``cells`` cells along the longest side.

    Places outside have the nearest point of the closest cell.
    """
    low, high = points_m.min(axis=0), points_m.max(axis=0)
    border = _BORDER * float(np.linalg.norm(high - low))
    low, high = low - border, high + border
    cell = float((high - low).max()) / cells
    shape = np.maximum(np.ceil((high - low) / cell).astype(np.int64), 1)
    axes = [low[k] + cell * (np.arange(shape[k]) + 0.5) for k in range(3)]
    centres = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    rows = nearest(kd_tree(points_m), centres)[1]
    return NearestGrid(rows.astype(np.int32).reshape(shape), low, cell)


@njit(cache=True, inline="always")
def nearest_row(grid: NearestGrid, x: float, y: float, z: float) -> int:  # pragma: no cover - compiled
    """Return the row of the point near a place."""
    i = int((x - grid.low_m[0]) / grid.cell_m)
    j = int((y - grid.low_m[1]) / grid.cell_m)
    k = int((z - grid.low_m[2]) / grid.cell_m)
    i = min(max(i, 0), grid.rows.shape[0] - 1)
    j = min(max(j, 0), grid.rows.shape[1] - 1)
    k = min(max(k, 0), grid.rows.shape[2] - 1)
    return int(grid.rows[i, j, k])

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Removal of cells through which rays of a later capture passed [1]_.

References
----------
.. [1] Fankhauser, P., Bloesch, M., Hutter, M. (2018). Probabilistic terrain mapping for mobile robots with
   uncertain localization. IEEE RA-L 3(4). doi:10.1109/LRA.2018.2849506 (visibility clean-up)
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.raster import GridGeometry
from cdff_core.elevation.map_cells import MapCells

Array = NDArray[np.float64]

#: Number of cells before the measured point at which a ray ends, since adjacent cells belong to the same
#: surface.
_BEFORE_HIT_CELLS = 3


def clear_seen_through(cells: MapCells, rays_m: Array, since_ns: int, margin_m: float) -> int:
    """Clear the cells below whose lowest height later rays passed; return their number.

    Parameters
    ----------
    cells : MapCells
        Changed in place.
    rays_m : ndarray, shape (n, 6)
        Position of the sensor (x y z) and of the measured point (x y z), metres.
    since_ns : int
        Cells that were measured at this time or later are kept.
    margin_m : float
        Distance below the lowest height of a cell at which two rays must pass, to allow for errors.
    """
    g, s = cells.geometry, cells.statistics
    lowest, second_lowest = np.full(g.shape, np.inf), np.full(g.shape, np.inf)
    _lowest_rays(
        np.ascontiguousarray(rays_m),
        g.resolution_m,
        g.xmin_m,
        g.ymax_m,
        _BEFORE_HIT_CELLS,
        lowest,
        second_lowest,
    )
    crossed = s.observed & (second_lowest < s.minimum - margin_m) & (s.newest_ns < since_ns)
    cells.clear(crossed)
    return int(np.count_nonzero(crossed))


def compile_now(resolution_m: float) -> None:
    """Compile the kernel, so that the first patch is not delayed."""
    clear_seen_through(
        MapCells.empty(GridGeometry("map", resolution_m, 0.0, resolution_m, 1, 1)), np.zeros((1, 6)), 0, 1.0
    )


@njit(cache=True)
def _lowest_rays(
    rays: Array, resolution: float, xmin: float, ymax: float, before: int, lowest: Array, second_lowest: Array
) -> None:
    """Set the heights of the lowest and second lowest ray over each cell, sampled once per cell."""
    rows, cols = lowest.shape
    for i in range(len(rays)):
        dx, dy, dz = rays[i, 3] - rays[i, 0], rays[i, 4] - rays[i, 1], rays[i, 5] - rays[i, 2]
        steps = int(np.hypot(dx, dy) / resolution)
        for k in range(steps - before):
            f = (k + 0.5) / steps
            col = int(np.floor((rays[i, 0] + f * dx - xmin) / resolution))
            row = int(np.floor((ymax - rays[i, 1] - f * dy) / resolution))
            if 0 <= row < rows and 0 <= col < cols:
                z = rays[i, 2] + f * dz
                if z < lowest[row, col]:
                    lowest[row, col], second_lowest[row, col] = z, lowest[row, col]
                elif z < second_lowest[row, col]:
                    second_lowest[row, col] = z

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Visibility from a point of an elevation grid, with its probability by the errors of the heights.

The grid is in a Cartesian frame, in which lines of sight are straight, so that no curvature is added. Lines
of sight to all cells are sampled (R3 of [1]_). The height that is visible above a cell depends on the heights
of the observer, of the cell that limits the view, and of the cell itself; an error that these share cancels.

References
----------
.. [1] Franklin, W. R., Ray, C. K. (1994). Higher isn't necessarily better: visibility algorithms and
   experiments. Advances in GIS Research, 6th Symposium on Spatial Data Handling.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import erf, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry

Float = NDArray[np.float64]

#: Largest number of cells.
MAX_CELLS = 1 << 20
#: An observer less than this many cells away from an edge may stand on either of its cells. GridGeometry
#: reduces bounds that exceed an edge by less than 1e-4 cells to that edge.
EDGE_CELLS = 1e-3
#: Rows that are computed between two checks of the time limit.
_ROWS = 32
_PROBABILITY_SIGMAS = np.linspace(-4.0, 4.0, 801)
_PROBABILITY = np.array([0.5 * (1.0 + erf(s / sqrt(2.0))) for s in _PROBABILITY_SIGMAS])


@dataclass(frozen=True, slots=True, eq=False)
class Viewshed:
    """Visibility of each cell; arrays ``(rows, cols)``, NaN where a cell is unobserved or too far away.

    Attributes
    ----------
    visible : Float
        Probability 0 to 1 that the target above the cell is visible; 0 or 1 where the errors are unknown.
    hidden_m : Float
        Height above the ground up to which the view is blocked; 0 where the ground is visible.
    sigma_m : Float
        Standard deviation of that height; NaN where unknown.
    unobserved : Float
        Fraction of the line of sight over unobserved ground, which does not block the view.
    """

    visible: Float
    hidden_m: Float
    sigma_m: Float
    unobserved: Float


def viewshed(
    geometry: GridGeometry,
    heights_m: ArrayLike,
    noise_m2: ArrayLike,
    observer_m: tuple[float, float],
    *,
    observer_height_m: float,
    target_height_m: float = 0.0,
    range_m: float | None = None,
    check: Callable[[int, int], None] = lambda _done, _total: None,
) -> Viewshed:
    """Return the visibility of all cells from the centre of the observer's cell.

    Parameters
    ----------
    heights_m, noise_m2 : array_like, shape (rows, cols)
        Heights, and their variance without the part that cells share; NaN where unknown.
    observer_m : tuple of float
        x, y in the frame of the grid, metres.
    observer_height_m, target_height_m : float
        Heights of the eye and of the target above the ground, metres.
    range_m : float, optional
        Longest line of sight.
    check : callable
        Called with the rows that are done and all rows; raises to end the work.

    Raises
    ------
    InputError
        If there are more than ``MAX_CELLS`` cells, or the ground under the observer is unobserved. On an
        edge between two cells, or of the grid, one observed cell is sufficient.
    """
    from cdff_common.raster._terrain_kernels import hidden_heights

    z = np.ascontiguousarray(heights_m, dtype=np.float64)
    noise = np.ascontiguousarray(noise_m2, dtype=np.float64)
    if z.size > MAX_CELLS:
        raise InputError(
            f"viewshed of {z.size} cells: expected at most {MAX_CELLS}; ask for a smaller range_m or a "
            "larger resolution_m"
        )
    row, col = _observer_cell(geometry, z, observer_m)
    required, variance, unobserved = (np.full(z.shape, np.nan) for _ in range(3))
    reach = np.inf if range_m is None else range_m / geometry.resolution_m
    for first in range(0, geometry.rows, _ROWS):
        check(first, geometry.rows)
        last = min(first + _ROWS, geometry.rows)
        hidden_heights(
            z, noise, row, col, observer_height_m, reach, first, last, required, variance, unobserved
        )
    sigma = np.sqrt(variance)
    with np.errstate(invalid="ignore", divide="ignore"):
        sigmas = np.clip((target_height_m - required) / sigma, -4.0, 4.0)
        visible = np.interp(sigmas, _PROBABILITY_SIGMAS, _PROBABILITY)
        certain = np.where(required <= target_height_m, 1.0, 0.0)
    visible = np.where(np.isfinite(sigma) & (sigma > 0.0), visible, certain)
    unknown = np.isnan(required)
    visible[unknown] = np.nan
    return Viewshed(visible, np.where(unknown, np.nan, np.maximum(required, 0.0)), sigma, unobserved)


def _observer_cell(geometry: GridGeometry, z: Float, observer_m: tuple[float, float]) -> tuple[int, int]:
    """Return the row and column of the first observed cell that contains the observer or has it on its edge;
    raises InputError without one.
    """
    x, y = observer_m
    edge_m = EDGE_CELLS * geometry.resolution_m
    offsets_m = (0.0, -edge_m, edge_m)
    dx, dy = np.meshgrid(offsets_m, offsets_m)
    rows, cols, inside = geometry.cells_of(x + dx.ravel(), y + dy.ravel())
    observed_rows = np.flatnonzero(inside & np.isfinite(z[rows, cols]))
    if not observed_rows.size:
        raise InputError(f"observer={x:g},{y:g}: the ground there is unobserved; choose a point on the map")
    return int(rows[observed_rows[0]]), int(cols[observed_rows[0]])

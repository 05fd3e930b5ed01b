# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Slope, aspect and roughness of an elevation grid by local planes, with the error of the slope.

The plane of a cell is fitted by least squares to the square of cells around it, as in [1]_. An error of the
pose that the cells share displaces the plane and does not tilt it: only the remaining part of the cells'
variance contributes to the error of the slope. The roughness is the standard deviation of the heights about
the plane; the variance of the measurement is subtracted where it is known.

References
----------
.. [1] Evans, I. S. (1980). An integrated system of terrain analysis and slope mapping. Zeitschrift fuer
   Geomorphologie, Suppl. 36.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError

Float = NDArray[np.float64]

#: Side of the largest square of cells, and largest number of cell pairs of one grid.
MAX_SIDE_CELLS = 61
MAX_PAIRS = 1 << 30


@dataclass(frozen=True, slots=True, eq=False)
class Surface:
    """Local planes of a grid; arrays ``(rows, cols)``, NaN where unknown.

    Attributes
    ----------
    slope_rad, sigma_slope_rad : Float
        Angle from the horizontal and its standard deviation.
    aspect_rad : Float
        Direction of descent, clockwise from +y, 0 to 2 pi; NaN also on level ground, which has none.
    roughness_m : Float
        Standard deviation of the heights about the plane.
    """

    slope_rad: Float
    sigma_slope_rad: Float
    aspect_rad: Float
    roughness_m: Float


def side_cells(baseline_m: float | None, resolution_m: float) -> int:
    """Return the odd number of cells along the side of the square for a baseline, at least 3.

    Raises
    ------
    InputError
        If it is more than ``MAX_SIDE_CELLS``.
    """
    if baseline_m is None:
        return 3
    side = max(3, 2 * round((baseline_m / resolution_m - 1.0) / 2.0) + 1)
    if side > MAX_SIDE_CELLS:
        raise InputError(
            f"baseline_m={baseline_m:g}: {side} cells of {resolution_m:g} m, expected at most "
            f"{MAX_SIDE_CELLS}; ask for a larger resolution_m"
        )
    return side


def local_surface(heights_m: ArrayLike, noise_m2: ArrayLike, resolution_m: float, side: int = 3) -> Surface:
    """Return the local planes of a grid.

    Parameters
    ----------
    heights_m : array_like, shape (rows, cols)
        Row 0 at ymax; NaN where unobserved.
    noise_m2 : array_like, shape (rows, cols)
        Variance of the heights without the part that cells share, square metres; NaN where unknown.
    resolution_m : float
        Edge of a cell, metres.
    side : int
        Odd number of cells along the side of the square; half of its cells must be observed.

    Raises
    ------
    InputError
        If there are too many cells for the side.
    """
    from cdff_common.raster._terrain_kernels import fit_planes

    z = np.ascontiguousarray(heights_m, dtype=np.float64)
    noise = np.ascontiguousarray(noise_m2, dtype=np.float64)
    if z.ndim != 2 or noise.shape != z.shape or side < 3 or side % 2 == 0:
        raise InputError(
            f"heights {z.shape}, variances {noise.shape}, side {side}: expected equal shapes, odd"
        )
    if z.size * side * side > MAX_PAIRS:
        raise InputError(
            f"{z.size} cells with a baseline of {side} cells: expected at most {MAX_PAIRS // side**2} cells; "
            "ask for a smaller region, a smaller baseline_m or a larger resolution_m"
        )
    planes = np.full((6, *z.shape), np.nan)
    fit_planes(z, noise, side // 2, float(resolution_m), max(side * side // 2 + 1, 4), planes)
    dx, dy, var_x, var_y, cov, about = planes
    squared = dx * dx + dy * dy
    with np.errstate(invalid="ignore", divide="ignore"):
        along = (dx * dx * var_x + 2.0 * dx * dy * cov + dy * dy * var_y) / squared
        # Near level ground the direction of descent is unknown.
        variance = np.where(
            squared > var_x + var_y, along, np.where(np.isnan(squared), np.nan, 0.5 * (var_x + var_y))
        )
        aspect = np.where(squared > 0.0, np.mod(np.arctan2(-dx, -dy), 2.0 * np.pi), np.nan)
    return Surface(np.arctan(np.sqrt(squared)), np.sqrt(variance) / (1.0 + squared), aspect, np.sqrt(about))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Refinement of position, rotation and height of points on a height grid to sub-cell precision, by least
squares.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import distance_transform_edt, gaussian_filter, map_coordinates, spline_filter

from cdff_common.arrays import BoolArray, FloatArray
from cdff_common.geometry.robust import median_sigma

#: Largest number of steps, and shift in cells at which the iteration has converged.
_ITERATIONS = 12
_CONVERGED_CELLS = 1e-4
#: Bound of the Huber weights in robust standard deviations: 95 % efficient for normal errors.
_HUBER = 1.345
#: Edge of the blocks within which residuals may be correlated, cells.
_BLOCK_CELLS = 4
#: Row, column, rotation, height and two tilts.
_PARAMETERS = 6
#: Standard deviation of the smoothing of heights for slopes, cells: noise of slopes would count as
#: information on the translation.
_SLOPE_CELLS = 1.2


@dataclass(frozen=True, slots=True, eq=False)
class HeightSurface:
    """Interpolated heights (cubic splines) and slopes between the centres of the cells of a grid.

    Positions are rows and columns, 0 at the centre of the first cell.

    Attributes
    ----------
    coefficients, slope_row, slope_col : FloatArray, shape (rows, cols)
    observed : BoolArray, shape (rows, cols)
        Cells with a height.
    """

    coefficients: FloatArray
    slope_row: FloatArray
    slope_col: FloatArray
    observed: BoolArray

    @classmethod
    def from_grid(cls, heights_m: FloatArray) -> HeightSurface:
        """Return the surface of a grid; holes (NaN) are filled for the splines, but are not observed."""
        hole = ~np.isfinite(heights_m)
        filled = heights_m
        if hole.any():
            nearest = distance_transform_edt(hole, return_distances=False, return_indices=True)
            filled = heights_m[tuple(nearest)]
        row, col = np.gradient(gaussian_filter(filled, _SLOPE_CELLS, mode="nearest"))
        return cls(spline_filter(filled, order=3, mode="nearest"), row, col, ~hole)

    def at(self, row: FloatArray, col: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, BoolArray]:
        """Return heights, slopes along rows and columns, and which positions are observed; each ``(n,)``."""
        position = np.stack([row, col])
        rows, cols = self.observed.shape
        inside = (row >= 0) & (row <= rows - 1) & (col >= 0) & (col <= cols - 1)
        r, c = (np.clip(np.rint(v), 0, n - 1).astype(int) for v, n in ((row, rows), (col, cols)))
        z = map_coordinates(self.coefficients, position, order=3, mode="nearest", prefilter=False)
        slopes = [
            map_coordinates(s, position, order=1, mode="nearest") for s in (self.slope_row, self.slope_col)
        ]
        return z, slopes[0], slopes[1], inside & self.observed[r, c]


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Estimated position of points on a surface, relative to their given position.

    Attributes
    ----------
    row, col : float
        Translation of the middle, cells.
    rotation_rad : float
        Rotation about the middle, from columns towards decreasing rows (counter-clockwise seen from above,
        with row 0 at the top).
    height_m : float
        Height of the surface above the points at the middle.
    covariance : FloatArray, shape (4, 4)
        Covariance of column, row, height and rotation: cells, metres, radians; not inflated.
    residual_m : float
        Root mean square of the height differences.
    relief_m : float
        Root mean square deviation of the points from their mean plane.
    cells : int
        Number of points on observed cells.
    """

    row: float
    col: float
    rotation_rad: float
    height_m: float
    covariance: FloatArray
    residual_m: float
    relief_m: float
    cells: int


def refine_placement(
    surface: HeightSurface, row: FloatArray, col: FloatArray, z_m: FloatArray, middle: tuple[float, float]
) -> Placement | None:
    """Minimise the height differences over translation, rotation, height and tilt, with Huber weights.

    Parameters
    ----------
    row, col, z_m : FloatArray, shape (n,)
        Points, cells and metres, near the solution.
    middle : tuple of float
        Row and column of the centre of rotation.

    Returns
    -------
    Placement or None
        None if too many points leave the grid or a direction is unconstrained. The covariance is a sandwich
        estimate over blocks of cells, since the errors of neighbouring cells are correlated.
    """
    y, x = row - middle[0], col - middle[1]
    p = np.zeros(_PARAMETERS)  # row, column, rotation, height, tilts along rows and columns
    for _ in range(_ITERATIONS):
        c, s = np.cos(p[2]), np.sin(p[2])
        r, k = middle[0] + p[0] + c * y - s * x, middle[1] + p[1] + c * x + s * y
        z, slope_row, slope_col, usable = surface.at(r, k)
        if np.count_nonzero(usable) < max(4 * _PARAMETERS, len(z_m) // 3):
            return None
        by_rotation = slope_row * (-s * y - c * x) + slope_col * (-s * x + c * y)
        J = np.column_stack([slope_row, slope_col, by_rotation, -np.ones_like(x), -y, -x])[usable]
        e = (z - z_m)[usable] - p[3] - p[4] * y[usable] - p[5] * x[usable]
        sigma_m = max(median_sigma(e - np.median(e)), 1e-9)
        w = np.minimum(1.0, _HUBER * sigma_m / np.maximum(np.abs(e), 1e-12))
        H = J.T @ (w[:, None] * J)
        scale = np.sqrt(np.maximum(np.diag(H), 1e-30))
        if np.linalg.cond(H / np.outer(scale, scale)) > 1e8:
            return None
        step = -np.linalg.solve(H, J.T @ (w * e))
        p += step
        if np.hypot(step[0], step[1]) < _CONVERGED_CELLS:
            break
    block = (row[usable] // _BLOCK_CELLS).astype(np.int64) * 100_003 + (col[usable] // _BLOCK_CELLS).astype(
        np.int64
    )
    _, index = np.unique(block, return_inverse=True)
    scores = np.zeros((int(index.max()) + 1, _PARAMETERS))
    np.add.at(scores, index, (w * e)[:, None] * J)
    inverse = np.linalg.inv(H)
    order = [1, 0, 3, 2]
    covariance = (inverse @ (scores.T @ scores) @ inverse)[np.ix_(order, order)]
    residual_m = float(np.sqrt(np.mean(e**2)))
    plane = np.column_stack([np.ones_like(x), x, y])[usable]
    deviation = z_m[usable] - plane @ np.linalg.lstsq(plane, z_m[usable], rcond=None)[0]
    return Placement(
        row=float(p[0]),
        col=float(p[1]),
        rotation_rad=float(p[2]),
        height_m=float(p[3]),
        covariance=covariance,
        residual_m=residual_m,
        relief_m=float(np.sqrt(np.mean(deviation**2))),
        cells=len(e),
    )

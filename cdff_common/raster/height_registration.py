# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration of two height grids in four degrees of freedom: translation and heading.

A correlation of both grids over all shifts [1]_ gives the starting point; a robust Gauss-Newton refinement
of the height differences follows.

References
----------
.. [1] Padfield, D. (2012). Masked object registration in the Fourier domain. IEEE Transactions on Image
   Processing 21(5). doi:10.1109/TIP.2011.2181402.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.geometry import GridGeometry

Grid = NDArray[np.float64]

#: Cells along an edge of the grids that are correlated, and cells that are compared in the refinement.
_CORRELATED, _COMPARED = 192, 20_000
#: Fewest common cells, also as a fraction of those without a shift.
_FEWEST, _COMMON_SHARE = 100, 0.5
#: Shifts are equally good within this fraction of the improvement.
_EQUAL_COST = 0.1
#: Headings from which the refinement starts, and its largest number of steps.
_HEADINGS_DEG = (0.0, -6.0, 6.0)
_ITERATIONS = 40
#: Smallest scale of the robust weights, metres: edges, which determine the heading, keep their weight.
_LEAST_SCALE_M = 0.1
#: Residuals of neighbouring cells are correlated: one of so many counts in the covariance.
_CORRELATED_CELLS = 25.0
#: Largest ratio of the residuals after and before a registration that is proposed.
_IMPROVEMENT = 0.7


@dataclass(frozen=True, slots=True, eq=False)
class HeightRegistration:
    """Transform that moves one height grid onto another.

    Attributes
    ----------
    T : array, shape (4, 4)
        Applied to points of the moved grid, in the frame of the grids, metres.
    sigma : array, shape (4,)
        Standard deviations of x, y, z (m) and heading (rad).
    residual_before_m, residual_after_m : float
        Robust standard deviation of the height differences.
    cells : int
        Compared cells.
    """

    T: Grid
    sigma: Grid
    residual_before_m: float
    residual_after_m: float
    cells: int

    def to_dict(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "T": self.T.tolist(),
            "sigma": self.sigma.tolist(),
            "residual_before_m": self.residual_before_m,
            "residual_after_m": self.residual_after_m,
            "cells": self.cells,
        }


def register_heights(geometry: GridGeometry, reference: Grid, moved: Grid) -> HeightRegistration | None:
    """Return the registration of ``moved`` onto ``reference``, heights ``(rows, cols)``, NaN where unknown.

    Returns
    -------
    registration : HeightRegistration or None
        None if the common cells are too few, or no transform reduces their residuals to 70 %.
    """
    common = np.isfinite(reference) & np.isfinite(moved)
    if np.count_nonzero(common) < _FEWEST:
        return None
    before_m = _rms((reference - moved)[common])
    columns, rows = np.meshgrid(np.arange(geometry.cols), np.arange(geometry.rows))
    known = np.flatnonzero(np.isfinite(moved))
    known = known[:: max(1, len(known) // _COMPARED)]
    points = np.column_stack([columns.ravel()[known], rows.ravel()[known]]).astype(np.float64)
    heights = moved.ravel()[known]
    centre = points.mean(axis=0)
    right, down = _best_shift(reference, moved)
    best: _Fit | None = None
    for heading_deg in _HEADINGS_DEG:
        start = np.array([right, down, 0.0, np.radians(heading_deg)])
        fitted = _refine(reference, points - centre, centre, heights, start)
        if fitted is not None and (best is None or fitted.rms_m < best.rms_m):
            best = fitted
    if best is None or best.rms_m > _IMPROVEMENT * before_m:
        return None
    after_m, (right, down, up, turn), covariance, cells = best
    # Rows count downwards: a turn of the image from columns to rows is one from x to -y.
    r, (column, row) = geometry.resolution_m, centre
    x, y = geometry.xmin_m + (column + 0.5) * r, geometry.ymax_m - (row + 0.5) * r
    c, s = np.cos(-turn), np.sin(-turn)
    T = np.eye(4)
    T[:2, :2] = [[c, -s], [s, c]]
    T[:2, 3] = np.array([x + right * r, y - down * r]) - T[:2, :2] @ [x, y]
    T[2, 3] = up
    sigma = np.sqrt(np.diag(covariance)) * [r, r, 1.0, 1.0]
    return HeightRegistration(T, sigma, before_m, after_m, cells)


class _Fit(NamedTuple):
    rms_m: float
    parameters: Grid  # columns, rows, height, turn
    covariance: Grid  # (4, 4)
    cells: int  # number of cells used


def _rms(values: Grid) -> float:
    """Return the robust root mean square, from the median of the magnitudes."""
    return float(1.4826 * np.median(np.abs(values))) if len(values) else np.inf


def _best_shift(reference: Grid, moved: Grid) -> tuple[float, float]:
    """Return columns and rows by which the moved grid fits best, up to an offset of the heights."""
    factor = max(1, -(-max(reference.shape) // _CORRELATED))
    a, b = _coarse(reference, factor), _coarse(moved, factor)
    known_a, known_b = np.isfinite(a), np.isfinite(b)
    offset = np.nanmedian(a)
    a, b = np.where(known_a, a - offset, 0.0), np.where(known_b, b - offset, 0.0)
    shape = (2 * a.shape[0], 2 * a.shape[1])

    def correlate(left: Grid, right: Grid) -> Grid:
        product = np.fft.rfft2(left, shape) * np.conj(np.fft.rfft2(right, shape))
        return np.asarray(np.fft.irfft2(product, shape), dtype=np.float64)

    mask_a, mask_b = known_a.astype(np.float64), known_b.astype(np.float64)
    n = correlate(mask_a, mask_b)
    total = np.maximum(n, 1.0)
    mean = (correlate(a, mask_b) - correlate(mask_a, b)) / total
    squares = (correlate(a * a, mask_b) - 2.0 * correlate(a, b) + correlate(mask_a, b * b)) / total
    enough = n >= max(_COMMON_SHARE * n[0, 0], _FEWEST / factor**2, 9.0)
    cost = np.where(enough, squares - mean * mean, np.inf)
    lowest = float(cost.min())
    if not np.isfinite(lowest):
        return 0.0, 0.0
    # Repeated terrain fits at several shifts: the smallest is the most likely one.
    rows, columns = np.nonzero(cost <= lowest + _EQUAL_COST * max(float(cost[0, 0]) - lowest, 0.0))
    down = np.where(rows >= a.shape[0], rows - shape[0], rows)
    right = np.where(columns >= a.shape[1], columns - shape[1], columns)
    nearest = int(np.argmin(down**2 + right**2))
    return float(right[nearest] * factor), float(down[nearest] * factor)


def _coarse(grid: Grid, factor: int) -> Grid:
    """Return the mean of blocks of ``factor`` cells, NaN where none is known."""
    rows, cols = -(-grid.shape[0] // factor), -(-grid.shape[1] // factor)
    padded = np.full((rows * factor, cols * factor), np.nan)
    padded[: grid.shape[0], : grid.shape[1]] = grid
    blocks = padded.reshape(rows, factor, cols, factor)
    known = np.isfinite(blocks)
    count = known.sum(axis=(1, 3))
    sums = np.where(known, blocks, 0.0).sum(axis=(1, 3))
    return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


def _refine(reference: Grid, offsets: Grid, centre: Grid, heights: Grid, start: Grid) -> _Fit | None:
    """Return the refined parameters; None if too few cells are usable.

    ``offsets`` (n, 2) are columns and rows of the moved cells relative to ``centre``.
    """
    parameters: Grid = np.array(start, dtype=np.float64)
    down_slope, right_slope = (np.asarray(np.gradient(reference, axis=k), np.float64) for k in (0, 1))
    residual, used_count = np.inf, 0
    normal: Grid = np.eye(4)
    for iteration in range(_ITERATIONS):
        c, s = np.cos(parameters[3]), np.sin(parameters[3])
        rotated_offsets: Grid = offsets @ np.array([[c, s], [-s, c]])
        target: Grid = rotated_offsets + centre + parameters[:2]
        column, row = target[:, 0], target[:, 1]
        height = _interpolate_heights(reference, column, row)
        i, j = np.rint(row).astype(np.int64), np.rint(column).astype(np.int64)
        inside = (i >= 0) & (i < reference.shape[0]) & (j >= 0) & (j < reference.shape[1])
        i, j = np.where(inside, i, 0), np.where(inside, j, 0)
        gx: Grid = right_slope[i, j]
        gy: Grid = down_slope[i, j]
        usable = np.flatnonzero(inside & np.isfinite(height) & np.isfinite(gx) & np.isfinite(gy))
        if len(usable) < _FEWEST:
            return None
        r = height[usable] - heights[usable] - parameters[2]
        if iteration == 0:
            shift = float(np.median(r))
            parameters[2] += shift
            r = r - shift
        residual, used_count = _rms(r), len(usable)
        gx, gy, rotated_offsets = gx[usable], gy[usable], rotated_offsets[usable]
        J: Grid = np.column_stack(
            [gx, gy, -np.ones(len(r)), gy * rotated_offsets[:, 0] - gx * rotated_offsets[:, 1]]
        )
        limit = 4.685 * max(residual, _LEAST_SCALE_M)
        w = np.where(np.abs(r) < limit, (1.0 - (r / limit) ** 2) ** 2, 0.0)
        normal = J.T @ (w[:, None] * J) + np.diag([1e-9, 1e-9, 1e-9, 1e-6])
        step: Grid = -np.linalg.solve(normal, J.T @ (w * r))
        step[:2] = np.clip(step[:2], -5.0, 5.0)
        parameters += step
        if np.abs(step[:2]).max() < 1e-3 and abs(step[2]) < 1e-5 and abs(step[3]) < 1e-5:
            break
    inverse = np.asarray(np.linalg.inv(normal), dtype=np.float64)
    covariance = inverse * max(residual, _LEAST_SCALE_M) ** 2 * _CORRELATED_CELLS
    return _Fit(residual, parameters, covariance, used_count)


def _interpolate_heights(grid: Grid, column: Grid, row: Grid) -> Grid:
    """Return bilinear heights at cell coordinates (n,), NaN outside or next to an unknown cell."""
    i, j = np.floor(row).astype(np.int64), np.floor(column).astype(np.int64)
    inside = (i >= 0) & (j >= 0) & (i < grid.shape[0] - 1) & (j < grid.shape[1] - 1)
    i, j = np.where(inside, i, 0), np.where(inside, j, 0)
    v, u = row - i, column - j
    if min(grid.shape) < 2:
        return np.full(len(row), np.nan)
    upper = (1.0 - u) * grid[i, j] + u * grid[i, j + 1]
    lower = (1.0 - u) * grid[i + 1, j] + u * grid[i + 1, j + 1]
    return np.where(inside, (1.0 - v) * upper + v * lower, np.nan)

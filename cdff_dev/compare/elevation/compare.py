# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Comparison of an elevation map with the true terrain.

References
----------
.. [1] Höhle, J., Höhle, M. (2009). Accuracy assessment of digital elevation models by means of robust
   statistical methods. ISPRS Journal 64(4). doi:10.1016/j.isprsjprs.2009.02.003 (NMAD, quantiles)
.. [2] Nuth, C., Kääb, A. (2011). Co-registration and bias corrections of satellite elevation data sets for
   quantifying glacier thickness change. The Cryosphere 5. doi:10.5194/tc-5-271-2011 (shift)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import correlate1d, map_coordinates

from cdff_common.errors import InputError
from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap

Grid = NDArray[np.float64]

#: Half width of the 90 % interval of a normal distribution, in standard deviations.
_Z_90 = 1.6448536269514722
#: Iterations of the least-squares estimate of the shift.
_MAX_ITERATIONS = 30
#: Largest difference of an error from the median that is used to estimate the shift, in NMAD.
_MAX_ERROR_NMAD = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class MapErrors:
    """Errors of the observed part of a map.

    Attributes
    ----------
    geometry : GridGeometry
        Cells of the part.
    mean, true, error, variance : ndarray, shape (rows, cols)
        Heights of the map and true heights, metres; their difference; its variance, m². NaN where unknown.
    interval_of : str
        Layer of the variance, empty if there is none.
    shift : ndarray, shape (5,)
        Correction of the best fit: east, north, up, metres; rise to the east and to the north, radians.
    is_shifted : bool
        Whether the error is that of the corrected map.
    """

    geometry: GridGeometry
    mean: Grid
    true: Grid
    error: Grid
    variance: Grid
    interval_of: str
    shift: NDArray[np.float64]
    is_shifted: bool


def errors_of(
    dem: ElevationMap, truth: ElevationMap, *, remove_shift: bool = False, least_count: int = 1
) -> MapErrors:
    """Return the error of each observed cell of a map.

    Parameters
    ----------
    dem : ElevationMap
        Layer ``mean``. With ``error_variance``, otherwise ``variance``, the coverage of intervals is
        reported. ``least_count`` needs the layer ``count``.
    truth : ElevationMap
        Layer ``mean``, in the same frame. If its cells are smaller, their mean over a cell of the map is
        used; otherwise its heights are interpolated at the centre of the cell.
    remove_shift : bool
        If True, the whole map is first translated and tilted to its best fit. The best fit is reported in
        both cases.
    least_count : int
        Cells with fewer measurements are ignored.

    Raises
    ------
    InputError
        If the frames differ or no cell of the map has a known true height.
    """
    if dem.frame != truth.frame:
        raise InputError(f"map in frame {dem.frame!r}, truth in {truth.frame!r}: expected one frame")
    mean = dem.layer("mean").astype(np.float64)
    if "count" in dem.layer_names:
        mean = np.where(dem.layer("count") >= least_count, mean, np.nan)
    row, col = np.nonzero(np.isfinite(mean))
    if not len(row):
        raise InputError("no cell of the map was observed")
    geometry = dem.geometry
    observed = GridGeometry.from_cells(
        geometry.frame,
        geometry.resolution_m,
        left=geometry.left + int(col.min()),
        top=geometry.top - int(row.min()),
        rows=int(np.ptp(row)) + 1,
        cols=int(np.ptp(col)) + 1,
    )
    window = geometry.slices_of(observed)
    mean = mean[window]
    shift = _shift(observed, mean, truth)
    correction = shift if remove_shift else np.zeros(5)
    true = true_heights(observed, truth, correction[:2])
    error = mean + _added_height_m(observed, correction) - true
    if not np.isfinite(error).any():
        raise InputError("no cell of the map has a known true height: check that the two overlap")
    interval = next((name for name in ("error_variance", "variance") if name in dem.layer_names), "")
    variance = dem.layer(interval)[window].astype(np.float64) if interval else np.full(mean.shape, np.nan)
    return MapErrors(observed, mean, true, error, variance, interval, shift, remove_shift)


def compare(
    dem: ElevationMap, truth: ElevationMap, *, remove_shift: bool = False, least_count: int = 1
) -> dict[str, Any]:
    """Return the accuracy of a map: ``accuracy_of`` of ``errors_of``."""
    return accuracy_of(errors_of(dem, truth, remove_shift=remove_shift, least_count=least_count))


def accuracy_of(errors: MapErrors) -> dict[str, Any]:
    """Return the accuracy of a map from its errors.

    Returns
    -------
    dict
        ``cells``, ``completeness`` (fraction of the true cells within the extent of the map that have a
        height in the map), ``bias_m``, ``rmse_m``, ``nmad_m`` and ``le90_m`` [1]_, ``max_m``,
        ``slope_rmse_deg``, ``within_90_percent`` (fraction of the true heights within 1.645 sigma, over the
        cells with a variance), ``cells_without_interval`` (number of cells without a variance, if any),
        ``chi2_per_cell``, and the correction of the best fit [2]_: ``shift_m`` (east, north, up) and
        ``tilt_mrad`` (rise to the east, to the north).
    """
    compared = np.isfinite(errors.error)
    compared_errors, resolution_m = errors.error[compared], errors.geometry.resolution_m
    mean = np.where(compared, errors.mean, np.nan)
    results: dict[str, Any] = {
        "cells": len(compared_errors),
        "completeness": len(compared_errors) / max(1, int(np.count_nonzero(np.isfinite(errors.true)))),
        "bias_m": float(compared_errors.mean()),
        "rmse_m": float(np.sqrt(np.mean(compared_errors**2))),
        "nmad_m": _nmad(compared_errors),
        "le90_m": float(np.percentile(np.abs(compared_errors), 90)),
        "max_m": float(np.abs(compared_errors).max()),
        "slope_rmse_deg": _slope_rmse_deg(mean, errors.true, resolution_m),
        "shift_m": [float(v) for v in errors.shift[:3]],
        "tilt_mrad": [1e3 * float(v) for v in errors.shift[3:]],
        "shift_removed": errors.is_shifted,
    }
    if errors.interval_of:
        variance = errors.variance[compared]
        has_variance = np.isfinite(variance)
        if not has_variance.all():  # a patch without variances was merged
            results["cells_without_interval"] = int(np.count_nonzero(~has_variance))
            compared_errors, variance = compared_errors[has_variance], variance[has_variance]
        results["interval_of"] = errors.interval_of
        results["within_90_percent"] = float(np.mean(np.abs(compared_errors) <= _Z_90 * np.sqrt(variance)))
        results["chi2_per_cell"] = float(np.median(compared_errors**2 / np.maximum(variance, 1e-12)) / 0.4549)
    return results


def true_heights(
    geometry: GridGeometry, truth: ElevationMap, shift_m: NDArray[np.float64] | None = None
) -> Grid:
    """Return the true height of each cell ``(rows, cols)``, metres; NaN where unknown.

    Parameters
    ----------
    shift_m : ndarray, shape (2,), optional
        East and north, metres, that are added to the positions of the cells before the true height is read.
    """
    t, heights = truth.geometry, truth.layer("mean").astype(np.float64)
    dx, dy = (0.0, 0.0) if shift_m is None else (float(v) for v in shift_m)
    cells_per_cell = max(
        1, round(geometry.resolution_m / t.resolution_m)
    )  # true cells along the edge of a map cell
    if cells_per_cell > 1 and dx == dy == 0.0:
        return _mean_over_cells(geometry, truth)
    # The true heights are averaged over the size of a cell and interpolated, so that the result is a
    # continuous function of the shift.
    if cells_per_cell > 1:
        for axis in (0, 1):
            heights = correlate1d(
                heights, np.full(cells_per_cell, 1.0 / cells_per_cell), axis, mode="nearest"
            )
    col = (geometry.x_centres_m() + dx - t.xmin_m) / t.resolution_m - 0.5
    row = (t.ymax_m - geometry.y_centres_m() - dy) / t.resolution_m - 0.5
    if cells_per_cell % 2 == 0:  # centre on an edge; correlate1d stores in the next cell
        row, col = row + 0.5, col + 0.5
    # Coinciding centres are not interpolated, since interpolation would enlarge unknown areas.
    is_aligned = max(np.abs(a - np.rint(a)).max() for a in (row, col)) < 1e-6
    if is_aligned:
        row, col = np.rint(row), np.rint(col)
    at = np.meshgrid(row, col, indexing="ij")
    return np.asarray(
        map_coordinates(heights, at, order=0 if is_aligned else 1, mode="constant", cval=np.nan)
    )


def _mean_over_cells(geometry: GridGeometry, truth: ElevationMap) -> Grid:
    """Return the mean of the true heights in each cell; NaN in cells without a true height."""
    heights = truth.layer("mean").astype(np.float64).ravel()
    x, y = truth.geometry.centres_m()
    row, col, inside = geometry.cells_of(x.ravel(), y.ravel())
    use = inside & np.isfinite(heights)
    cell, cells = (row * geometry.cols + col)[use], geometry.rows * geometry.cols
    with np.errstate(invalid="ignore"):
        mean = np.bincount(cell, heights[use], cells) / np.bincount(cell, minlength=cells)
    return np.asarray(mean.reshape(geometry.shape))


def table(results: dict[str, Any]) -> str:
    """Return the results as text, one line per result."""
    unit = {"m": " m", "deg": " deg"}
    rows = []
    for name, value in results.items():
        text = ", ".join(f"{v:.4f}" for v in value) if isinstance(value, list) else _text(value)
        rows.append(
            f"{name.rsplit('_', 1)[0] if name.endswith(('_m', '_deg')) else name:18} {text}"
            + next((u for end, u in unit.items() if name.endswith(f"_{end}")), "")
        )
    return "\n".join(rows)


def _text(value: Any) -> str:
    return f"{value:.4f}" if isinstance(value, float) else str(value)


def _nmad(error: Grid) -> float:
    return float(1.4826 * np.median(np.abs(error - np.median(error))))


def _slope_rmse_deg(mean: Grid, true: Grid, resolution_m: float) -> float:
    """Return the root mean square difference of the slopes, degrees; NaN without neighbouring cells."""
    if min(mean.shape) < 2:
        return float("nan")
    slopes = [np.degrees(np.arctan(np.hypot(*np.gradient(z, resolution_m)))) for z in (mean, true)]
    difference = (slopes[0] - slopes[1])[np.isfinite(slopes[0] - slopes[1])]
    return float(np.sqrt(np.mean(difference**2))) if len(difference) else float("nan")


def _added_height_m(geometry: GridGeometry, correction: NDArray[np.float64]) -> Grid:
    """Return the height that translation and tilt add to each cell ``(rows, cols)``, metres."""
    x, y = geometry.centres_m()
    return np.asarray(correction[2] + correction[3] * (x - x.mean()) + correction[4] * (y - y.mean()))


def _shift(geometry: GridGeometry, mean: Grid, truth: ElevationMap) -> NDArray[np.float64]:
    """Return the best-fit correction: east, north, up (metres), rise to the east and north (radians)."""
    correction = np.zeros(5)
    if min(mean.shape) < 2:
        return correction
    x, y = geometry.centres_m()
    for _ in range(_MAX_ITERATIONS):
        true = true_heights(geometry, truth, correction[:2])
        down, east = map(np.asarray, np.gradient(true, geometry.resolution_m))
        error = mean + _added_height_m(geometry, correction) - true
        use = np.isfinite(error) & np.isfinite(east) & np.isfinite(down)
        if np.count_nonzero(use) < 10:
            return correction
        used_errors: Grid = error[use]
        is_inlier = np.abs(used_errors - np.median(used_errors)) <= _MAX_ERROR_NMAD * max(
            _nmad(used_errors), 1e-9
        )
        ones = np.ones(len(used_errors))
        A = np.column_stack([east[use], -down[use], -ones, x.mean() - x[use], y.mean() - y[use]])[is_inlier]
        step = np.linalg.lstsq(A, used_errors[is_inlier], rcond=None)[0]
        correction += step
        if np.abs(step).max() < 1e-4:
            break
    return correction

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Aggregation of fine cells to coarser ones by pooling, and area means on a grid with other edges; cells are
never refined.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.statistics import CellStatistics

#: Rounding error of a ratio of cell sizes that counts as a whole number.
_RELATIVE_TOLERANCE = 1e-6
#: Minimum observed fraction of the area of a cell of ``area_means``.
_MIN_AREA = 0.9


def integer_factor(fine_m: float, coarse_m: float) -> int:
    """Return the number of fine cells along a coarse one; raises InputError if it is not a positive
    integer.
    """
    factor = round(coarse_m / fine_m)
    if factor < 1 or abs(coarse_m / fine_m - factor) > _RELATIVE_TOLERANCE * factor:
        raise InputError(
            f"cells of {fine_m} m do not fit into cells of {coarse_m} m: expected an integer multiple"
        )
    return factor


def delivered_resolution(resolutions_m: Iterable[float], requested_m: float | None = None) -> float:
    """Return the cell size of a result pooled from grids of several cell sizes.

    The coarsest of them times the largest integer that stays at or below ``requested_m``: data are never
    upsampled, and a result is coarser than requested only if the data are.

    Raises
    ------
    InputError
        If there is no grid, ``requested_m`` is not above 0, or a cell size does not divide the coarsest.
    """
    resolutions = list(resolutions_m)
    if not resolutions:
        raise InputError("no grid given")
    if requested_m is not None and not (np.isfinite(requested_m) and requested_m > 0.0):
        raise InputError(f"resolution_m={requested_m}: expected metres above 0")
    coarsest = max(resolutions)
    for resolution in resolutions:
        integer_factor(resolution, coarsest)
    return (
        coarsest
        if requested_m is None
        else coarsest * max(1, floor(requested_m / coarsest + _RELATIVE_TOLERANCE))
    )


def aggregate(statistics: CellStatistics, factor: int) -> CellStatistics:
    """Pool blocks of ``factor`` x ``factor`` cells, aligned in the frame.

    Raises
    ------
    InputError
        If ``factor`` is below 1.
    """
    if factor == 1:
        return statistics
    from cdff_common.raster._kernels import pool_blocks

    s, fine = statistics, statistics.geometry
    result = CellStatistics.empty(fine.coarsened(factor))
    down, right = result.geometry.top * factor - fine.top, fine.left - result.geometry.left * factor
    pool_blocks(s.arrays, factor, down, right, (*result.arrays, np.zeros(result.geometry.shape)))
    return result


def aggregate_to(statistics: CellStatistics, resolution_m: float) -> CellStatistics:
    """Pool to cells of ``resolution_m``; raises InputError if it is not an integer multiple of the cell
    size.
    """
    return aggregate(statistics, integer_factor(statistics.geometry.resolution_m, resolution_m))


def _begins(count: int, lead: int, factor: int) -> NDArray[np.intp]:
    """Return the starts of blocks of ``factor`` cells among ``count``, with ``lead`` cells missing in the
    first.
    """
    return np.concatenate([[0], np.arange(factor - lead, count, factor)]).astype(np.intp)


def largest_of_blocks(
    layers: Mapping[str, NDArray[Any]], geometry: GridGeometry, factor: int
) -> tuple[dict[str, NDArray[Any]], GridGeometry]:
    """Return layers with cells ``factor`` times as large; each cell has the largest value of its block.

    For hazards the worst cell counts.

    Parameters
    ----------
    layers : mapping of str to array, shape (rows, cols)
        Whole numbers with 0 for unknown, or numbers with NaN; a cell is unknown only if all cells of its
        block are.
    """
    coarse = geometry.coarsened(factor)
    top, left = coarse.top * factor - geometry.top, geometry.left - coarse.left * factor
    coarse_layers = {}
    for name, layer in layers.items():
        is_float = np.issubdtype(layer.dtype, np.floating)
        lowest = layer.dtype.type(-np.inf if is_float else 0)
        values = np.where(layer == layer, layer, lowest)
        largest = np.maximum.reduceat(values, _begins(geometry.rows, top, factor), axis=0)
        largest = np.maximum.reduceat(largest, _begins(geometry.cols, left, factor), axis=1)
        coarse_layers[name] = (
            np.where(np.isneginf(largest), np.nan, largest).astype(layer.dtype) if is_float else largest
        )
    return coarse_layers, coarse


def area_means(
    heights: NDArray[Any], bounds: tuple[float, float, float, float], target: GridGeometry
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean and the variance of heights in the cells of a grid, weighted by the common area.

    A cell needs observed heights on 90 % of its area, so that its mean is not displaced. On a plane the mean
    is the height of the centre, exactly if the cells have equal size or one is a multiple of the other, else
    to 8 % of the difference between adjacent cells. The variance is that of the heights within the cell: the
    loss of detail by the resampling.

    Parameters
    ----------
    heights : NDArray, shape (rows, cols)
        Row 0 at the top; NaN where unobserved.
    bounds : tuple of float
        Outer edges (xmin, ymin, xmax, ymax) of the heights in the frame of the target, metres.
    target : GridGeometry

    Returns
    -------
    mean, variance : NDArray[np.float64], of the shape of ``target``
        NaN where too little is observed.
    """
    xmin, ymin, xmax, ymax = bounds
    rows, cols = heights.shape
    r = target.resolution_m
    down = _overlaps((target.ymax_m - ymax) / r, (target.ymax_m - ymin) / r, rows, target.rows)
    right = _overlaps((xmin - target.xmin_m) / r, (xmax - target.xmin_m) / r, cols, target.cols)
    observed = np.isfinite(heights)
    offset = float(np.mean(heights[observed], dtype=np.float64)) if observed.any() else 0.0
    z = np.where(observed, heights - offset, 0.0)
    area, first, second = (
        np.asarray((right @ (down @ values).T).T) for values in (observed.astype(np.float64), z, z * z)
    )
    area = np.where(area >= _MIN_AREA, area, np.nan)
    mean = first / area
    return mean + offset, np.maximum(second / area - mean**2, 0.0)


def _overlaps(start: float, end: float, count: int, target_count: int) -> Any:
    """Return the sparse matrix (target_count, count) of the overlaps of cells with target cells of size 1.

    ``count`` cells divide the interval from ``start`` to ``end``.
    """
    from scipy.sparse import csr_array

    edges = start + (end - start) / count * np.arange(count + 1)
    cuts = np.unique(np.concatenate([edges, np.arange(target_count + 1)]))
    middles = 0.5 * (cuts[1:] + cuts[:-1])
    cell, target = np.searchsorted(edges, middles) - 1, np.floor(middles).astype(np.int64)
    use = (cell >= 0) & (cell < count) & (target >= 0) & (target < target_count)
    return csr_array((np.diff(cuts)[use], (target[use], cell[use])), shape=(target_count, count))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Coarser cells from finer ones, by pooling; finer from coarser never, for that would invent measurements."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from math import floor
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.statistics import CellStatistics

_RELATIVE_TOLERANCE = 1e-6


def integer_factor(fine_m: float, coarse_m: float) -> int:
    """How many fine cells make one coarse cell along an edge; raises InputError if that is no integer of at least 1."""
    factor = round(coarse_m / fine_m)
    if factor < 1 or abs(coarse_m / fine_m - factor) > _RELATIVE_TOLERANCE * factor:
        raise InputError(f"cells of {fine_m} m do not fit into cells of {coarse_m} m: expected an integer multiple")
    return factor


def delivered_resolution(resolutions_m: Iterable[float], wanted_m: float | None = None) -> float:
    """Cell size that is delivered when grids of several cell sizes are pooled.

    The coarsest of them times the largest integer that stays at or below ``wanted_m``: coarser data are never
    upsampled, and an answer is not coarser than asked unless the data are.

    Raises
    ------
    InputError
        If there is no grid, ``wanted_m`` is not above 0, or a cell size does not divide the coarsest.
    """
    known = list(resolutions_m)
    if not known:
        raise InputError("no grid to take a cell size from")
    if wanted_m is not None and not (np.isfinite(wanted_m) and wanted_m > 0.0):
        raise InputError(f"resolution_m={wanted_m}: expected metres above 0")
    coarsest = max(known)
    for resolution in known:
        integer_factor(resolution, coarsest)
    return coarsest if wanted_m is None else coarsest * max(1, floor(wanted_m / coarsest + _RELATIVE_TOLERANCE))


def aggregate(statistics: CellStatistics, factor: int) -> CellStatistics:
    """Pool blocks of ``factor`` x ``factor`` cells; the result's cells are aligned in the frame as all grids are.

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
    pool_blocks(
        (s.count, s.mean, s.m2, s.minimum, s.maximum), s.newest_ns, factor, down, right,
        result.count, result.mean, result.m2, result.minimum, result.maximum, result.newest_ns,
        np.zeros(result.geometry.shape),
    )  # fmt: skip
    return result


def aggregate_to(statistics: CellStatistics, resolution_m: float) -> CellStatistics:
    """Pool to cells of exactly ``resolution_m``; raises InputError if that is no integer multiple of the cell size."""
    return aggregate(statistics, integer_factor(statistics.geometry.resolution_m, resolution_m))


def _begins(count: int, lead: int, factor: int) -> NDArray[np.intp]:
    """Where blocks of ``factor`` cells begin among ``count`` cells, of whose first block ``lead`` are missing."""
    return np.concatenate([[0], np.arange(factor - lead, count, factor)]).astype(np.intp)


def largest_of_blocks(
    layers: Mapping[str, NDArray[Any]], geometry: GridGeometry, factor: int
) -> tuple[dict[str, NDArray[Any]], GridGeometry]:
    """Layers of cells ``factor`` times as large, each the largest of those in it: for hazards the worst one counts.

    Parameters
    ----------
    layers : mapping of str to array, shape (rows, cols)
        Whole numbers with 0 for unknown, or numbers with NaN; a cell is unknown only where all in it are.
    """
    coarse = geometry.coarsened(factor)
    top, left = coarse.top * factor - geometry.top, geometry.left - coarse.left * factor
    made = {}
    for name, layer in layers.items():
        is_float = np.issubdtype(layer.dtype, np.floating)
        least = layer.dtype.type(-np.inf if is_float else 0)
        known = np.where(layer == layer, layer, least)
        largest = np.maximum.reduceat(known, _begins(geometry.rows, top, factor), axis=0)
        largest = np.maximum.reduceat(largest, _begins(geometry.cols, left, factor), axis=1)
        made[name] = np.where(np.isneginf(largest), np.nan, largest).astype(layer.dtype) if is_float else largest
    return made, coarse

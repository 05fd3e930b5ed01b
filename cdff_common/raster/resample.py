# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Coarser cells from finer ones, by pooling; finer from coarser never, for that would invent measurements."""

from __future__ import annotations

from collections.abc import Iterable
from math import floor

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
    fine = statistics.geometry
    coarse = fine.coarsened(factor)
    frame = GridGeometry.from_cells(
        fine.frame,
        fine.resolution_m,
        left=coarse.left * factor,
        top=coarse.top * factor,
        rows=coarse.rows * factor,
        cols=coarse.cols * factor,
    )
    padded = statistics if frame == fine else statistics.window(frame)
    n = _blocks(padded.count, factor)
    mean = _blocks(padded.mean, factor)
    total = n.sum(axis=(1, 3))
    divisor = np.where(total > 0, total, 1.0)
    pooled = (n * mean).sum(axis=(1, 3)) / divisor
    difference = mean - pooled[:, None, :, None]
    # The mean of the differences is zero up to rounding; adding it back makes the mean as good as a two-pass one.
    correction = (n * difference).sum(axis=(1, 3)) / divisor
    m2 = _blocks(padded.m2, factor).sum(axis=(1, 3)) + (n * difference**2).sum(axis=(1, 3)) - total * correction**2
    return CellStatistics(
        coarse,
        total,
        pooled + correction,
        np.maximum(m2, 0.0),
        _blocks(padded.minimum, factor).min(axis=(1, 3)),
        _blocks(padded.maximum, factor).max(axis=(1, 3)),
        padded.newest_ns.reshape(coarse.rows, factor, coarse.cols, factor).max(axis=(1, 3)),
    )


def aggregate_to(statistics: CellStatistics, resolution_m: float) -> CellStatistics:
    """Pool to cells of exactly ``resolution_m``; raises InputError if that is no integer multiple of the cell size."""
    return aggregate(statistics, integer_factor(statistics.geometry.resolution_m, resolution_m))


def _blocks(values: NDArray[np.float64], factor: int) -> NDArray[np.float64]:
    rows, cols = values.shape
    return values.reshape(rows // factor, factor, cols // factor, factor)

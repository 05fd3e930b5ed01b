# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cells of a window during its assembly, and the pooling of one map; ``mosaic`` checks the arguments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import UncertainTransform
from cdff_common.raster import _kernels
from cdff_common.raster.auxiliary_layers import POOLED_LAYERS, STATISTICS, AuxiliaryLayers
from cdff_common.raster.cell_selection import Choice
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.statistics import CellStatistics

_NO_COVARIANCE: NDArray[np.float64] = np.zeros((6, 6))
#: Empty auxiliary layers, read-only as the layers of messages, and sums of cells without these.
_NO_LAYER = np.zeros((0, 0), np.float32)
_NO_LAYER.setflags(write=False)
_NO_SUMS: NDArray[np.float64] = np.zeros((0, 0, STATISTICS))
#: Arrays of ``CellStatistics``.
_STATISTICS = ("count", "mean", "m2", "minimum", "maximum", "newest_ns")


@dataclass(slots=True, eq=False)
class WindowCells:
    """Statistics of cells, and their auxiliary layers once a map has some."""

    statistics: CellStatistics
    auxiliary: AuxiliaryLayers | None = None

    def with_auxiliary(self) -> AuxiliaryLayers:
        """Return the auxiliary layers, unknown for the heights that were pooled without them."""
        if self.auxiliary is None:
            self.auxiliary = AuxiliaryLayers.unknown(self.statistics.geometry, self.statistics.observed)
        return self.auxiliary

    def add(self, part: WindowCells) -> None:
        """Pool a part of the window."""
        if part.auxiliary is not None:
            self.with_auxiliary().add(part.auxiliary)
        self.statistics.add(part.statistics)

    def copy(self, target: tuple[slice, slice], other: WindowCells, source: tuple[slice, slice]) -> None:
        """Copy the cells of another grid at ``source`` to ``target``, where no cell has a height."""
        if other.auxiliary is not None or self.auxiliary is not None:
            auxiliary = self.with_auxiliary()
            theirs = other.auxiliary or AuxiliaryLayers.unknown(
                other.statistics.geometry, other.statistics.observed
            )
            auxiliary.sums[target] = theirs.sums[source]
        for name in _STATISTICS:
            getattr(self.statistics, name)[target] = getattr(other.statistics, name)[source]

    def select(self, slices: tuple[slice, slice], part: WindowCells, choice: Choice) -> None:
        """Replace the cells for which the rule prefers the part."""
        mine, theirs = self.statistics, part.statistics
        if choice is Choice.NEWEST:
            preferred = theirs.newest_ns >= mine.newest_ns[slices]
        elif choice is Choice.OLDEST:
            preferred = (mine.count[slices] == 0) | (theirs.newest_ns < mine.newest_ns[slices])
        else:
            preferred = (mine.count[slices] == 0) | (
                _height_variance(theirs) < _height_variance(mine, slices)
            )
        self.replace(part, preferred & (theirs.count > 0), slices)

    def replace(self, part: WindowCells, selected: NDArray[np.bool_], slices: Any = ...) -> None:
        """Replace the selected cells at ``slices`` by those of a part."""
        if part.auxiliary is not None:
            np.copyto(self.with_auxiliary().sums[slices], part.auxiliary.sums, where=selected[..., None])
        for name in _STATISTICS:
            np.copyto(getattr(self.statistics, name)[slices], getattr(part.statistics, name), where=selected)


@dataclass(frozen=True, slots=True, eq=False)
class MapSource:
    """Map to be pooled into cells.

    Attributes
    ----------
    geometry : GridGeometry
    arrays : tuple of array
        The six layers.
    auxiliary : tuple of array or None
        The layers ``auxiliary_layers.POOLED_LAYERS``; None if none are requested or known yet.
    t1_ns : int
    factor : int or None
        Result of ``mosaic.fitting_factor``; None for a map that is resampled.
    T_window_map : UncertainTransform or None
        Transform of a map in another frame.
    """

    geometry: GridGeometry
    arrays: tuple[Any, ...]
    auxiliary: tuple[Any, ...] | None
    t1_ns: int
    factor: int | None
    T_window_map: UncertainTransform | None

    def pool_into(self, cells: WindowCells, within: NDArray[np.float64]) -> None:
        """Pool the part of the map that lies in the cells; the m2 within each map is added to ``within``."""
        g, window = self.geometry, cells.statistics.geometry
        arrays = (*cells.statistics.arrays, within)
        layers = (*self.arrays, *(self.auxiliary or (_NO_LAYER,) * len(POOLED_LAYERS)))
        # Requested before the heights are pooled, so that only heights of earlier maps are marked unknown.
        sums = _NO_SUMS if self.auxiliary is None else cells.with_auxiliary().sums
        if self.factor is not None:
            offset = window.top * self.factor - g.top, g.left - window.left * self.factor
            map_grid = g.resolution_m, g.left, g.top
            _kernels.pool_layers(layers, self.t1_ns, *map_grid, self.factor, *offset, arrays, sums)
            return
        T = self.T_window_map
        matrix: NDArray[np.float64] = np.eye(4) if T is None else np.ascontiguousarray(T.matrix)
        covariance = _NO_COVARIANCE
        if T is not None and T.covariance is not None:
            covariance = np.ascontiguousarray(T.covariance)
        map_grid = g.resolution_m, g.left, g.top
        window_grid = window.resolution_m, window.left, window.top
        _kernels.pool_resampled(layers, self.t1_ns, *map_grid, matrix, covariance, *window_grid, arrays, sums)


def _height_variance(cells: CellStatistics, slices: Any = ...) -> NDArray[np.float64]:
    """Return the variance for comparison: infinite for a single height without a stated variance."""
    count, m2 = cells.count[slices], cells.m2[slices]
    variance = m2 / np.where(count > 0, count, 1.0)
    return np.where((count <= 1.0) & (m2 == 0.0), np.inf, variance)

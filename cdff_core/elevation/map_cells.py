# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cells of a map to which patches are added, and the windows of moving and tiled maps."""

from __future__ import annotations

from dataclasses import dataclass
from math import floor

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import CellStatistics, GridGeometry, aggregate
from cdff_common.raster.auxiliary_layers import AuxiliaryLayers
from cdff_common.raster.resample import integer_factor
from cdff_common.raster.statistics import NEVER_NS
from cdff_common.types import ElevationMap


@dataclass(slots=True, eq=False)
class MapCells:
    """Statistics of the heights and auxiliary layers on one grid."""

    statistics: CellStatistics
    auxiliary: AuxiliaryLayers

    @classmethod
    def empty(cls, geometry: GridGeometry) -> MapCells:
        """Return unobserved cells."""
        return cls(CellStatistics.empty(geometry), AuxiliaryLayers.empty(geometry))

    @classmethod
    def of_map(cls, dem: ElevationMap, resolution_m: float | None = None) -> MapCells:
        """Return the cells of a map, optionally in larger cells; raises InputError if these do not fit."""
        layers = {name: dem.layer(name) for name in dem.layer_names}
        fine = cls(CellStatistics.from_layers(dem.geometry, layers, dem.t1_ns), AuxiliaryLayers.of_map(dem))
        if resolution_m is None or resolution_m == dem.geometry.resolution_m:
            return fine
        return fine.coarsened(integer_factor(dem.geometry.resolution_m, resolution_m))

    @property
    def geometry(self) -> GridGeometry:
        """Grid of the cells."""
        return self.statistics.geometry

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        parts = (self.statistics, self.auxiliary)
        arrays = [
            getattr(part, name) for part in parts for name in part.__dataclass_fields__ if name != "geometry"
        ]
        return int(sum(a.nbytes for a in arrays))

    def add(self, other: MapCells) -> None:
        """Add the measurements in cells of the same size; cells outside the grid are ignored."""
        self.statistics.add(other.statistics)
        self.auxiliary.add(other.auxiliary)

    def window(self, geometry: GridGeometry) -> MapCells:
        """Return a copy of the cells in another window."""
        return MapCells(self.statistics.window(geometry), self.auxiliary.window(geometry))

    def coarsened(self, factor: int) -> MapCells:
        """Return cells ``factor`` times as large; the same object for a factor of 1."""
        if factor == 1:
            return self
        return MapCells(aggregate(self.statistics, factor), self.auxiliary.coarsened(factor))

    def clear(self, cells: NDArray[np.bool_]) -> None:
        """Make the cells of a mask ``(rows, cols)`` unobserved."""
        s = self.statistics
        for array in (s.count, s.mean, s.m2):
            array[cells] = 0.0
        s.minimum[cells], s.maximum[cells], s.newest_ns[cells] = np.inf, -np.inf, NEVER_NS
        self.auxiliary.clear(cells)

    def to_map(self, t0_ns: int, t1_ns: int) -> ElevationMap:
        """Return the map of these cells."""
        layers = self.statistics.to_layers(t1_ns) | self.auxiliary.to_layers(self.statistics, t1_ns)
        return ElevationMap.from_layers(self.geometry, layers, t0_ns=t0_ns, t1_ns=t1_ns)


def middle_of(geometry: GridGeometry) -> NDArray[np.float64]:
    """Return the centre (x, y) of a grid, metres."""
    b = geometry.bounds
    return np.array([0.5 * (b.xmin + b.xmax), 0.5 * (b.ymin + b.ymax)])


def bounds_of(bounds: NDArray[np.float64]) -> tuple[float, float, float, float]:
    """Return an array ``(4,)`` of xmin, ymin, xmax, ymax as a tuple."""
    xmin, ymin, xmax, ymax = (float(v) for v in bounds)
    return xmin, ymin, xmax, ymax


def window_around(frame: str, resolution_m: float, xy_m: NDArray[np.float64], size_m: float) -> GridGeometry:
    """Return the square grid, aligned with the cells of the frame, with a position in its middle cell, or in
    the upper right one of its four middle cells.
    """
    cells = max(1, round(size_m / resolution_m))
    left = floor(xy_m[0] / resolution_m) - cells // 2
    top = floor(xy_m[1] / resolution_m) + 1 + (cells - 1) // 2
    return GridGeometry.from_cells(frame, resolution_m, left=left, top=top, rows=cells, cols=cells)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cells of a map that grows patch by patch: statistics of the heights and what else is known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import CellStatistics, GridGeometry, aggregate
from cdff_common.raster.further_layers import FurtherLayers
from cdff_common.raster.resample import integer_factor
from cdff_common.raster.statistics import NEVER_NS
from cdff_common.types import ElevationMap


@dataclass(slots=True, eq=False)
class MapCells:
    """Statistics and further layers of one grid.

    Attributes
    ----------
    statistics : CellStatistics
    further : FurtherLayers
    """

    statistics: CellStatistics
    further: FurtherLayers

    @classmethod
    def empty(cls, geometry: GridGeometry) -> MapCells:
        """Nothing observed."""
        return cls(CellStatistics.empty(geometry), FurtherLayers.empty(geometry))

    @classmethod
    def of_map(cls, dem: ElevationMap, resolution_m: float | None = None) -> MapCells:
        """A map's cells, pooled into larger ones where asked; raises InputError where they do not fit into these."""
        layers = {name: dem.layer(name) for name in dem.layer_names}
        fine = cls(CellStatistics.from_layers(dem.geometry, layers, dem.t1_ns), FurtherLayers.of_map(dem))
        if resolution_m is None or resolution_m == dem.geometry.resolution_m:
            return fine
        return fine.coarsened(integer_factor(dem.geometry.resolution_m, resolution_m))

    @property
    def geometry(self) -> GridGeometry:
        """Where the cells lie."""
        return self.statistics.geometry

    @property
    def nbytes(self) -> int:
        """Memory of the arrays, bytes."""
        parts = (self.statistics, self.further)
        arrays = [getattr(part, name) for part in parts for name in part.__dataclass_fields__ if name != "geometry"]
        return int(sum(a.nbytes for a in arrays))

    def add(self, other: MapCells) -> None:
        """Pool cells of the same size; what lies outside is left out."""
        self.statistics.add(other.statistics)
        self.further.add(other.further)

    def window(self, geometry: GridGeometry) -> MapCells:
        """A copy in another window of the same cells."""
        return MapCells(self.statistics.window(geometry), self.further.window(geometry))

    def coarsened(self, factor: int) -> MapCells:
        """Pooled into cells ``factor`` times as large; themselves for a factor of 1."""
        if factor == 1:
            return self
        return MapCells(aggregate(self.statistics, factor), self.further.coarsened(factor))

    def forget(self, cells: NDArray[np.bool_]) -> None:
        """Unlearn cells ``(rows, cols)``."""
        s = self.statistics
        for array in (s.count, s.mean, s.m2):
            array[cells] = 0.0
        s.minimum[cells], s.maximum[cells], s.newest_ns[cells] = np.inf, -np.inf, NEVER_NS
        self.further.forget(cells)

    def to_map(self, t0_ns: int, t1_ns: int) -> ElevationMap:
        """The map of these cells."""
        layers = self.statistics.to_layers(t1_ns) | self.further.to_layers(self.statistics, t1_ns)
        return ElevationMap.from_layers(self.geometry, layers, t0_ns=t0_ns, t1_ns=t1_ns)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of heights in the cells of a grid."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.raster.further_layers import FurtherLayers
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_rasterisation._interface import (
    DemRasterisationInputs,
    DemRasterisationInterface,
    DemRasterisationOutputs,
)


class CellStatisticsRasterConfig(DfnConfig):
    """Frame, cell size and limits."""

    frame: str = Field("map", description="Frame the points are in")
    resolution_m: float = Field(0.05, gt=0.0, le=1000.0, description="Edge of a cell, metres")
    max_cells: int = Field(16_000_000, ge=1, le=1 << 30, description="Most cells of a grid")
    overhang_gap_m: float | None = Field(
        None, gt=0.0, description="Empty height above which all is an overhang, metres; absent: none is looked for"
    )


class CellStatisticsRaster(DemRasterisationInterface):
    """Count, mean, variance, least, greatest and newest of the heights in each cell; empty cells stay NaN.

    ``variance`` is the variance of the heights in the cell (divided by their number) plus the mean of their own
    variances, if given. It is the variance of the mixture they make, and pools exactly.

    With ``overhang_gap_m`` the heights of a cell above the lowest gap of that size are left out, and the lowest of them
    is in the layer ``overhang_m``, where there are two of them at least. A cell of which only the overhang was seen
    takes it for ground.
    """

    Config: ClassVar[type[DfnConfig]] = CellStatisticsRasterConfig

    def setup(self) -> None:
        """Compile, so that the first cloud is as fast as the others."""
        grid = GridGeometry.aligned(self.config.frame, self.config.resolution_m, (0.0, 0.0, 0.0, 0.0))
        statistics = CellStatistics.from_points(grid, np.zeros((1, 3)), stamps_ns=0)
        FurtherLayers.empty(grid).to_layers(statistics, 0)
        for writeable in (True, False):
            points = np.zeros((1, 3))
            points.setflags(write=writeable)
            GridGeometry.around(self.config.frame, self.config.resolution_m, points)

    def process(self, inputs: DemRasterisationInputs) -> DemRasterisationOutputs:
        """Return the elevation map of the cloud.

        Raises
        ------
        InputError
            If no point is finite, the arrays do not fit or the grid would have more than ``max_cells`` cells.
        """
        points = checked_points(inputs.points, least=0, finite=False)
        grid = GridGeometry.around(self.config.frame, self.config.resolution_m, points, self.config.max_cells)
        stamps = np.zeros(1, np.int64) if inputs.stamps_ns is None else np.asarray(inputs.stamps_ns, dtype=np.int64)
        t0_ns, t1_ns = int(np.min(stamps)) // 1000 * 1000, -(-int(np.max(stamps)) // 1000) * 1000
        ground = points
        further = None
        if inputs.noise_variance is not None or inputs.intensity is not None or self.config.overhang_gap_m is not None:
            cell = _cells(grid, points)
            for name in ("noise_variance", "intensity"):
                given = getattr(inputs, name)
                if given is not None and np.shape(given) != (len(points),):
                    raise InputError(f"{len(points)} points, {name} {np.shape(given)}: expected one of each")
            further = FurtherLayers.empty(grid)
            if self.config.overhang_gap_m is not None:
                hanging = overhanging(cell, points[:, 2], self.config.overhang_gap_m)
                # One point alone is noise: neither ground nor overhang.
                real = hanging & (np.bincount(cell[hanging], minlength=grid.rows * grid.cols) > 1)[cell]
                np.minimum.at(further.overhang.reshape(-1), cell[real], points[real, 2])
                ground, cell = np.where(hanging[:, None], np.nan, points), np.where(hanging, -1, cell)
        statistics = CellStatistics.from_points(
            grid, ground, stamps_ns=stamps, height_variance_m2=_sum(inputs.height_variance, inputs.noise_variance)
        )
        if further is not None:
            _fill(further, cell, stamps, inputs)
        layers = statistics.to_layers(t1_ns)
        if further is not None:
            layers |= further.to_layers(statistics, t1_ns)
        return DemRasterisationOutputs(map=ElevationMap.from_layers(grid, layers, t0_ns=t0_ns, t1_ns=t1_ns))


def _cells(grid: GridGeometry, points: NDArray[np.float64]) -> NDArray[np.int64]:
    """Flat index of each point's cell, -1 where it is not finite."""
    finite = np.isfinite(points).all(axis=1)
    row, col, inside = grid.cells_of(*np.where(finite, points[:, :2].T, 0.0))
    return np.where(finite & inside, row * grid.cols + col, -1).astype(np.int64)


def overhanging(cell: NDArray[np.int64], z_m: NDArray[np.float64], gap_m: float) -> NDArray[np.bool_]:
    """Points ``(n,)`` above the lowest empty height of ``gap_m`` in their cell; cell -1 is no cell."""
    cells = int(cell.max(initial=0)) + 1
    low, high = np.full(cells, np.inf), np.full(cells, -np.inf)
    use = cell >= 0
    np.minimum.at(low, cell[use], z_m[use])
    np.maximum.at(high, cell[use], z_m[use])
    tall = np.flatnonzero(use & ((high - low)[cell] >= gap_m))
    hanging = np.zeros(len(cell), dtype=np.bool_)
    order = tall[np.lexsort((z_m[tall], cell[tall]))]
    c, z = cell[order], z_m[order]
    begins = np.r_[True, c[1:] != c[:-1]] if len(c) else np.zeros(0, dtype=np.bool_)
    jump = np.r_[False, (z[1:] - z[:-1] >= gap_m) & ~begins[1:]] if len(c) else begins
    jumps = np.cumsum(jump)
    hanging[order] = jumps > jumps[np.maximum.accumulate(np.where(begins, np.arange(len(c)), 0))] if len(c) else False
    return hanging


def _sum(first: NDArray[np.float64] | None, second: NDArray[np.float64] | None) -> NDArray[np.float64] | None:
    """Both variances, where given."""
    if first is None or second is None:
        return first if second is None else second
    return np.asarray(first + second)


def _fill(
    further: FurtherLayers, cell: NDArray[np.int64], stamps: NDArray[np.int64], inputs: DemRasterisationInputs
) -> None:
    """Sum what the inputs have beyond heights."""
    use, shape = cell >= 0, further.geometry.shape
    at, size = cell[use], further.geometry.rows * further.geometry.cols
    if inputs.height_variance is not None:
        further.pose_m2 = np.bincount(at, np.asarray(inputs.height_variance)[use], size).reshape(shape)
    if inputs.intensity is not None:
        brightness = np.asarray(inputs.intensity, dtype=np.float64)
        lit = use & np.isfinite(brightness)
        further.brightness = np.bincount(cell[lit], brightness[lit], size).reshape(shape)
        further.lit = np.bincount(cell[lit], minlength=size).reshape(shape).astype(np.float64)
    np.minimum.at(further.first_ns.reshape(-1), at, np.broadcast_to(stamps, cell.shape)[use])

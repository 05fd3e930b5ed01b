# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of heights in the cells of a grid."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import CellStatistics, GridGeometry
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


class CellStatisticsRaster(DemRasterisationInterface):
    """Count, mean, variance, least, greatest and newest of the heights in each cell; empty cells stay NaN.

    ``variance`` is the variance of the heights in the cell (divided by their number) plus the mean of their own
    variances, if given. It is the variance of the mixture they make, and pools exactly.
    """

    Config: ClassVar[type[DfnConfig]] = CellStatisticsRasterConfig

    def setup(self) -> None:
        """Compile, so that the first cloud is as fast as the others."""
        grid = GridGeometry.aligned(self.config.frame, self.config.resolution_m, (0.0, 0.0, 0.0, 0.0))
        CellStatistics.from_points(grid, np.zeros((1, 3)), stamps_ns=0)

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
        statistics = CellStatistics.from_points(
            grid, points, stamps_ns=stamps, height_variance_m2=inputs.height_variance
        )
        t0_ns, t1_ns = int(np.min(stamps)) // 1000 * 1000, -(-int(np.max(stamps)) // 1000) * 1000
        layers = statistics.to_layers(t1_ns)
        return DemRasterisationOutputs(map=ElevationMap.from_layers(grid, layers, t0_ns=t0_ns, t1_ns=t1_ns))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Statistics of heights in the cells of a grid."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.raster import CellStatistics, GridGeometry
from cdff_common.raster.auxiliary_layers import (
    FIRST_US,
    INTENSITY_COUNT,
    INTENSITY_SUM,
    OVERHANG_M,
    POSE_VARIANCE_SUM,
    AuxiliaryLayers,
)
from cdff_common.types import ElevationMap
from cdff_core.dfns.dem_rasterisation._overhangs import find_overhanging_structure, find_overhangs
from cdff_core.dfns.dem_rasterisation.interface import Inputs, Interface, Outputs


class CellStatisticsRasterConfig(DfnConfig):
    """Parameters of CellStatisticsRaster."""

    resolution_m: float = Field(0.05, gt=0, le=1000, description="Edge of a cell")
    max_cells: int = Field(16_000_000, ge=1, le=1 << 30, description="Maximum number of cells of a grid")
    overhang_gap_m: float | None = Field(
        None,
        gt=0,
        description=(
            "Smallest vertical gap between the ground and an overhang, at least half of the edge of a cell; "
            "absent: overhangs are not separated"
        ),
    )


class CellStatisticsRaster(Interface[CellStatisticsRasterConfig]):
    """Count, mean, variance, minimum, maximum and age of the heights in each cell; empty cells are NaN.

    ``variance`` is the population variance of the heights in the cell plus the mean of their own variances,
    if given. It is the variance of a mixture, so that pooling two cells gives the variance of all their
    points.

    With ``overhang_gap_m``, heights above the lowest empty space of a cell are excluded from its statistics.
    If there are at least two, the lowest of them is stored in the layer ``overhang_m``. If only the overhang
    was observed in a cell, it is treated as ground. In cells much larger than the gap, relief hides empty
    spaces; a ground filter then has to find the structure (``is_structure``).
    """

    def setup(self) -> None:
        """Compile the kernels."""
        grid = GridGeometry.aligned("map", self.config.resolution_m, (0.0, 0.0, 0.0, 0.0))
        statistics = CellStatistics.from_points(grid, np.zeros((1, 3)), stamps_ns=0)
        AuxiliaryLayers.empty(grid).to_layers(statistics, 0)
        # Arrays of messages are read-only, which is another type for the compiler.
        for writeable in (True, False):
            points = np.zeros((1, 3))
            points.setflags(write=writeable)
            GridGeometry.around("map", self.config.resolution_m, points)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the elevation map of the cloud.

        Raises
        ------
        InputError
            If no point is finite, or the grid would have more than ``max_cells`` cells.
        """
        points = checked_points(inputs.points, least=0, finite=False)
        resolution_m = self.config.resolution_m if inputs.resolution_m is None else inputs.resolution_m
        grid = GridGeometry.around(inputs.frame or "map", resolution_m, points, self.config.max_cells)
        stamps = (
            np.zeros(1, np.int64)
            if inputs.stamps_ns is None
            else np.asarray(inputs.stamps_ns, dtype=np.int64)
        )
        t0_ns, t1_ns = int(np.min(stamps)) // 1000 * 1000, -(-int(np.max(stamps)) // 1000) * 1000
        ground = points
        auxiliary = None
        if (
            inputs.noise_variance is not None
            or inputs.intensity is not None
            or self.config.overhang_gap_m is not None
        ):
            cell = _cell_indices(grid, points)
            auxiliary = AuxiliaryLayers.empty(grid)
            if self.config.overhang_gap_m is not None:
                gap_m = self.config.overhang_gap_m
                is_overhang = (
                    find_overhangs(cell, points, gap_m, resolution_m)
                    if inputs.is_structure is None
                    else find_overhanging_structure(cell, points, inputs.is_structure, gap_m, resolution_m)
                )
                # A single point above the gap is noise: neither ground nor overhang.
                is_mapped_overhang = (
                    is_overhang & (np.bincount(cell[is_overhang], minlength=grid.rows * grid.cols) > 1)[cell]
                )
                auxiliary.minimum_at(OVERHANG_M, cell[is_mapped_overhang], points[is_mapped_overhang, 2])
                ground, cell = np.where(is_overhang[:, None], np.nan, points), np.where(is_overhang, -1, cell)
        statistics = CellStatistics.from_points(
            grid,
            ground,
            stamps_ns=stamps,
            height_variance_m2=_sum_variances(inputs.height_variance, inputs.noise_variance),
        )
        if auxiliary is not None:
            auxiliary.set_counts(statistics.count)
            _fill_auxiliary_layers(auxiliary, cell, stamps, inputs)
        layers = statistics.to_layers(t1_ns)
        if auxiliary is not None:
            layers |= auxiliary.to_layers(statistics, t1_ns)
        return Outputs(map=ElevationMap.from_layers(grid, layers, t0_ns=t0_ns, t1_ns=t1_ns))


def _cell_indices(grid: GridGeometry, points: FloatArray) -> IntArray:
    """Return the flat index of the cell of each point; -1 for points that are not finite."""
    finite = np.isfinite(points).all(axis=1)
    row, col, inside = grid.cells_of(*np.where(finite, points[:, :2].T, 0.0))
    return np.where(finite & inside, row * grid.cols + col, -1).astype(np.int64)


def _sum_variances(first: FloatArray | None, second: FloatArray | None) -> FloatArray | None:
    """Return the sum of two variances of each point; an absent one is 0, None if both are absent."""
    if first is None or second is None:
        return first if second is None else second
    return np.asarray(first + second)


def _fill_auxiliary_layers(
    auxiliary: AuxiliaryLayers,
    cell: IntArray,
    stamps: IntArray,
    inputs: Inputs,
) -> None:
    """Fill the auxiliary layers from the optional inputs."""
    has_cell, grid, sums = cell >= 0, auxiliary.geometry, auxiliary.sums
    shape, observed_cell, cell_count = grid.shape, cell[has_cell], grid.rows * grid.cols
    if inputs.height_variance is not None:
        variance = np.asarray(inputs.height_variance)[has_cell]
        sums[..., POSE_VARIANCE_SUM] = np.bincount(observed_cell, variance, cell_count).reshape(shape)
    if inputs.intensity is not None:
        intensity = np.asarray(inputs.intensity, dtype=np.float64)
        has_intensity = has_cell & np.isfinite(intensity)
        sums[..., INTENSITY_SUM] = np.bincount(
            cell[has_intensity], intensity[has_intensity], cell_count
        ).reshape(shape)
        sums[..., INTENSITY_COUNT] = np.bincount(cell[has_intensity], minlength=cell_count).reshape(shape)
    auxiliary.minimum_at(FIRST_US, observed_cell, np.broadcast_to(stamps * 1e-3, cell.shape)[has_cell])

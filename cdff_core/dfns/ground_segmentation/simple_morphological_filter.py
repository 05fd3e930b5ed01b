# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ground by progressive opening of the surface of lowest points.

References
----------
.. [1] Pingel, T. J., Clarke, K. C., McBride, W. A. (2013). An improved simple morphological filter for the terrain
   classification of airborne LIDAR data. ISPRS Journal 77. doi:10.1016/j.isprsjprs.2012.12.002
.. [2] Zhang, K., et al. (2003). A progressive morphological filter for removing nonground measurements from airborne
   LIDAR data. IEEE TGRS 41(4). doi:10.1109/TGRS.2003.810682 (eq. 7: the greatest threshold)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar, Literal

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.ndimage import map_coordinates

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.ground_segmentation._interface import (
    GroundSegmentationInputs,
    GroundSegmentationInterface,
    GroundSegmentationOutputs,
)
from cdff_core.dfns.ground_segmentation.inpainting import inpainted

FloatGrid = NDArray[np.float64]

#: Offsets of the grids in cells, used in this order.
_PHASES = ((0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5))
#: A cell this steeply below all of its neighbours is an error of the sensor, not a hole in the ground [1]_.
_OUTLIER_SLOPE = 5.0


class SimpleMorphologicalFilterConfig(DfnConfig):
    """Scales of the ground and of what stands on it; the defaults are for airborne lidar of about one point a m2."""

    cell_m: float = Field(1.25, gt=0.0, le=100.0, description="Edge of a cell of the surface of lowest points, metres")
    window_m: float = Field(40.0, gt=0.0, le=1000.0, description="Radius of the largest opening, metres")
    slope: float = Field(0.2, gt=0.0, le=10.0, description="Rise over the opened surface per metre of radius")
    max_step_m: float = Field(2.0, gt=0.0, le=100.0, description="Rise that no ground has, whatever the radius, metres")
    tolerance_m: float = Field(0.3, gt=0.0, le=100.0, description="Distance from the ground's surface, metres")
    tolerance_per_slope_m: float = Field(1.4, ge=0.0, le=100.0, description="Added per unit of the slope, metres")
    phases: Literal[1, 2, 4] = Field(4, description="Grids shifted by parts of a cell, averaged")
    max_cells: int = Field(4_000_000, ge=1, le=1 << 28, description="Most cells of a grid")


class SimpleMorphologicalFilter(GroundSegmentationInterface):
    """SMRF [1]_ with a greatest threshold [2]_, on several grids.

    The lowest point of each cell makes a surface; it is opened by disks of growing radius, and cells that rise above
    the opened surface by more than ``slope`` times the radius, or ``max_step_m``, are not ground. The surface through
    the others is the ground; a point is ground within ``tolerance_m`` of it, more where it is steep.

    Where an edge of a cell falls decides which point is its lowest. The surfaces of grids shifted by half a cell are
    averaged. The greatest threshold keeps flat roofs of any height out, however wide the opening that finds them.
    """

    Config: ClassVar[type[DfnConfig]] = SimpleMorphologicalFilterConfig

    def process(self, inputs: GroundSegmentationInputs) -> GroundSegmentationOutputs:
        """Return the ground points; raises InputError where there are none or the cloud is too wide."""
        given = checked_points(inputs.points, least=0, finite=False)
        finite = np.flatnonzero(np.all(np.isfinite(given), axis=1))
        if not len(finite):
            raise InputError(f"points: none of {len(given)} is finite")
        points = given[finite]
        c = self.config
        heights, slopes = np.zeros(len(points)), np.zeros(len(points))
        for shift in _PHASES[: c.phases]:
            for sums, values in zip((heights, slopes), self._ground_at(points, shift), strict=True):
                sums += values / c.phases
        above_m = np.full(len(given), np.nan)
        above_m[finite] = points[:, 2] - heights
        ground = finite[np.abs(above_m[finite]) <= c.tolerance_m + c.tolerance_per_slope_m * slopes]
        if not len(ground):
            raise InputError(f"points: nothing of {len(points)} looks like ground with {c}")
        return GroundSegmentationOutputs(
            ground=ground.astype(np.int64), ground_points=given[ground], height_above_ground=above_m
        )

    def _ground_at(self, points: FloatGrid, shift: tuple[float, float]) -> tuple[FloatGrid, FloatGrid]:
        """Height and slope of the ground below each point ``(n,)``, from one grid."""
        cell_m = self.config.cell_m
        at = points[:, :2] / cell_m
        at -= np.floor(at.min(axis=0)) - np.asarray(shift)
        surface = self._ground(self._lowest(at.astype(np.int64), points[:, 2]))
        steepness = np.hypot(*_gradient(surface, cell_m))
        centre = (at - 0.5).T
        height, slope = (map_coordinates(grid, centre, order=1, mode="nearest") for grid in (surface, steepness))
        return np.asarray(height), np.asarray(slope)

    def _lowest(self, cell: NDArray[np.int64], z_m: FloatGrid) -> FloatGrid:
        """Grid of lowest heights, NaN where there is no point."""
        shape = tuple(int(n) + 1 for n in cell.max(axis=0))
        if shape[0] * shape[1] > self.config.max_cells:
            raise InputError(
                f"points: {shape[0]} x {shape[1]} cells of {self.config.cell_m} m, expected at most "
                f"max_cells={self.config.max_cells}; use larger cells or cut the cloud"
            )
        lowest = np.full(shape, np.inf)
        np.minimum.at(lowest, (cell[:, 0], cell[:, 1]), z_m)
        return np.where(np.isinf(lowest), np.nan, lowest)

    def _ground(self, lowest: FloatGrid) -> FloatGrid:
        """Surface through the cells that no object stands on."""
        c = self.config
        whole = inpainted(lowest)
        outlier = _rises(-whole, [1], [_OUTLIER_SLOPE * c.cell_m])
        if outlier.any() and not outlier[np.isfinite(lowest)].all():
            whole = inpainted(np.where(outlier, np.nan, lowest))
        radii = range(1, max(1, int(np.ceil(c.window_m / c.cell_m))) + 1)
        thresholds = [min(c.slope * radius * c.cell_m, c.max_step_m) for radius in radii]
        bare = np.isfinite(lowest) & ~outlier & ~_rises(whole, radii, thresholds)
        return inpainted(np.where(bare, whole, np.nan)) if bare.any() else whole


def _rises(surface: FloatGrid, radii: Sequence[int], thresholds_m: Sequence[float]) -> NDArray[np.bool_]:
    """Cells that stand out of the surface opened by disks of rising radius (cells), each opened further."""
    level = float(surface.min())
    before = (surface - level).astype(np.float32)
    standing = np.zeros(surface.shape, dtype=np.bool_)
    for radius, threshold_m in zip(radii, thresholds_m, strict=True):
        opened = cv2.morphologyEx(before, cv2.MORPH_OPEN, _disk(radius), borderType=cv2.BORDER_REPLICATE)
        standing |= before - opened > threshold_m
        before = opened
    return standing


def _disk(radius: int) -> NDArray[np.uint8]:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(x * x + y * y <= radius * radius, dtype=np.uint8)


def _gradient(surface: FloatGrid, cell_m: float) -> list[FloatGrid]:
    """Derivatives along both axes; 0 along an axis of one cell."""
    return [
        np.gradient(surface, cell_m, axis=axis) if surface.shape[axis] > 1 else np.zeros_like(surface)
        for axis in (0, 1)
    ]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ground classification by progressive opening of the surface of lowest points.

References
----------
.. [1] Pingel, T. J., Clarke, K. C., McBride, W. A. (2013). An improved simple morphological filter for the
   terrain classification of airborne LIDAR data. ISPRS Journal 77. doi:10.1016/j.isprsjprs.2012.12.002
.. [2] Zhang, K., et al. (2003). A progressive morphological filter for removing nonground measurements from
   airborne LIDAR data. IEEE TGRS 41(4). doi:10.1109/TGRS.2003.810682 (eq. 7: the upper bound of the
   threshold)
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import cv2
import numpy as np
from pydantic import Field
from scipy.ndimage import map_coordinates

from cdff_common.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.ground_segmentation.inpainting import inpaint
from cdff_core.dfns.ground_segmentation.interface import Inputs, Interface, Outputs

#: Offsets of the grids in cells, used in this order.
_PHASES = ((0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5))
#: Slope to its neighbours above which an isolated low cell is a sensor error [1]_.
_OUTLIER_SLOPE = 5.0


class SimpleMorphologicalFilterConfig(DfnConfig):
    """Parameters of SimpleMorphologicalFilter; the defaults suit airborne lidar, one point per m2."""

    cell_m: float = Field(1.25, gt=0, le=100, description="Edge of a cell of the grid of lowest points")
    window_m: float = Field(
        40.0,
        gt=0,
        le=1000,
        description="Radius of the largest opening; objects wider than that are classified as ground",
    )
    slope: float = Field(
        0.2,
        gt=0,
        le=10,
        description="Height above the opened surface from which a cell is an object, per metre of radius",
    )
    max_step_m: float = Field(
        2.0, gt=0, le=100, description="Upper bound of the threshold given by slope and radius"
    )
    tolerance_m: float = Field(
        0.3, gt=0, le=100, description="Largest vertical distance of a ground point from level ground"
    )
    tolerance_per_slope_m: float = Field(
        1.4, ge=0, le=100, description="Additional tolerance per unit of slope"
    )
    phases: Literal[1, 2, 4] = Field(
        4, description="Number of shifted grids whose ground surfaces are averaged"
    )
    max_cells: int = Field(4_000_000, ge=1, le=1 << 28, description="Maximum number of cells of a grid")


class SimpleMorphologicalFilter(Interface[SimpleMorphologicalFilterConfig]):
    """SMRF [1]_ with an upper bound of the threshold [2]_, on several grids.

    The lowest points of the cells form a surface, which is opened by disks of increasing radius. Cells that
    exceed the opened surface by more than ``slope`` times the radius, or by more than ``max_step_m``, are
    objects. The ground is the surface interpolated through the other cells. A point is ground if its vertical
    distance from this surface is at most ``tolerance_m``, and more on slopes.

    Since the lowest point of a cell depends on the position of its edges, the surfaces of several grids
    shifted by half a cell are averaged. The upper bound of the threshold is needed for flat roofs: at a large
    radius the product of slope and radius exceeds their height.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the ground points; raises InputError if there are none or the grid has too many cells."""
        all_points = checked_points(inputs.points, least=0, finite=False)
        finite = np.flatnonzero(np.all(np.isfinite(all_points), axis=1))
        if not len(finite):
            raise InputError(f"points: none of {len(all_points)} is finite")
        points = all_points[finite]
        cfg = self.config
        heights, slopes = np.zeros(len(points)), np.zeros(len(points))
        for shift in _PHASES[: cfg.phases]:
            for total, values in zip((heights, slopes), self._ground_below(points, shift), strict=True):
                total += values / cfg.phases
        height_above_ground = np.full(len(all_points), np.nan)
        height_above_ground[finite] = points[:, 2] - heights
        ground = finite[
            np.abs(height_above_ground[finite]) <= cfg.tolerance_m + cfg.tolerance_per_slope_m * slopes
        ]
        if not len(ground):
            raise InputError(f"points: none of {len(points)} is classified as ground with {cfg}")
        return Outputs(
            ground=ground.astype(np.int64),
            ground_points=all_points[ground],
            height_above_ground=height_above_ground,
        )

    def _ground_below(self, points: FloatArray, offset: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Return height and slope ``(n,)`` of the ground below each point, from one grid."""
        cell_m = self.config.cell_m
        cell_position = points[:, :2] / cell_m
        cell_position -= np.floor(cell_position.min(axis=0)) - np.asarray(offset)
        surface = self._ground_surface(self._lowest_heights(cell_position.astype(np.int64), points[:, 2]))
        steepness = np.hypot(*_gradient(surface, cell_m))
        grid_position = (cell_position - 0.5).T
        height, slope = (
            map_coordinates(grid, grid_position, order=1, mode="nearest") for grid in (surface, steepness)
        )
        return np.asarray(height), np.asarray(slope)

    def _lowest_heights(self, cell: IntArray, z_m: FloatArray) -> FloatArray:
        """Return the grid of lowest heights; NaN for cells without points."""
        shape = tuple(int(n) + 1 for n in cell.max(axis=0))
        if shape[0] * shape[1] > self.config.max_cells:
            raise InputError(
                f"points: {shape[0]} x {shape[1]} cells of {self.config.cell_m} m, expected at most "
                f"max_cells={self.config.max_cells}; use larger cells or cut the cloud"
            )
        lowest = np.full(shape, np.inf)
        np.minimum.at(lowest, (cell[:, 0], cell[:, 1]), z_m)
        return np.where(np.isinf(lowest), np.nan, lowest)

    def _ground_surface(self, lowest_m: FloatArray) -> FloatArray:
        """Return the surface interpolated through the cells that are neither objects nor outliers."""
        cfg = self.config
        surface = inpaint(lowest_m)
        is_outlier = _find_objects(-surface, [1], [_OUTLIER_SLOPE * cfg.cell_m])
        if is_outlier.any() and not is_outlier[np.isfinite(lowest_m)].all():
            surface = inpaint(np.where(is_outlier, np.nan, lowest_m))
        radii = range(1, max(1, int(np.ceil(cfg.window_m / cfg.cell_m))) + 1)
        thresholds = [min(cfg.slope * radius * cfg.cell_m, cfg.max_step_m) for radius in radii]
        is_ground = np.isfinite(lowest_m) & ~is_outlier & ~_find_objects(surface, radii, thresholds)
        return inpaint(np.where(is_ground, surface, np.nan)) if is_ground.any() else surface


def _find_objects(surface: FloatArray, radii: Sequence[int], thresholds_m: Sequence[float]) -> BoolArray:
    """Return the cells that exceed the opened surface for one of the radii by its threshold.

    The surface is opened successively by disks of increasing radius, in cells.
    """
    minimum_m = float(surface.min())
    previous = (surface - minimum_m).astype(np.float32)
    is_object = np.zeros(surface.shape, dtype=np.bool_)
    for radius, threshold_m in zip(radii, thresholds_m, strict=True):
        opened = cv2.morphologyEx(previous, cv2.MORPH_OPEN, _disk(radius), borderType=cv2.BORDER_REPLICATE)
        is_object |= previous - opened > threshold_m
        previous = np.asarray(opened, np.float32)
    return is_object


def _disk(radius: int) -> ByteArray:
    """Return the structuring element of a disk."""
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(x * x + y * y <= radius * radius, dtype=np.uint8)


def _gradient(surface: FloatArray, cell_m: float) -> list[FloatArray]:
    """Return the derivatives along both axes; 0 along an axis of one cell."""
    return [
        np.gradient(surface, cell_m, axis=axis) if surface.shape[axis] > 1 else np.zeros_like(surface)
        for axis in (0, 1)
    ]

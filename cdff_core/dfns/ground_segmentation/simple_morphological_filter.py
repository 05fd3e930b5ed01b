# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ground classification by progressive opening of the surface of lowest points.

References
----------
.. [1] Pingel, T. J., Clarke, K. C., McBride, W. A. (2013). An improved simple morphological filter for the
   terrain
   classification of airborne LIDAR data. ISPRS Journal 77. doi:10.1016/j.isprsjprs.2012.12.002
.. [2] Zhang, K., et al. (2003). A progressive morphological filter for removing nonground measurements from
   airborne
   LIDAR data. IEEE TGRS 41(4). doi:10.1109/TGRS.2003.810682 (eq. 7: the greatest threshold)
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
from cdff_core.dfns.ground_segmentation.inpainting import inpainted
from cdff_core.dfns.ground_segmentation.interface import Inputs, Interface, Outputs

#: Offsets of the grids in cells, used in this order.
_PHASES = ((0.0, 0.0), (0.5, 0.5), (0.5, 0.0), (0.0, 0.5))
#: Slope to all neighbours above which a low cell is a sensor error [1]_.
_OUTLIER_SLOPE = 5.0


class SimpleMorphologicalFilterConfig(DfnConfig):
    """Parameters of SimpleMorphologicalFilter; the defaults suit airborne lidar, one point per m2."""

    cell_m: float = Field(1.25, gt=0, le=100, description="Edge of a cell of the grid of lowest points")
    window_m: float = Field(
        40.0, gt=0, le=1000, description="Radius of the largest opening; wider objects are ground"
    )
    slope: float = Field(
        0.2, gt=0, le=10, description="Threshold above the opened surface per metre of radius"
    )
    max_step_m: float = Field(2.0, gt=0, le=100, description="Largest threshold above the opened surface")
    tolerance_m: float = Field(
        0.3, gt=0, le=100, description="Largest distance of a ground point from level ground"
    )
    tolerance_per_slope_m: float = Field(
        1.4, ge=0, le=100, description="Additional tolerance per unit of slope"
    )
    phases: Literal[1, 2, 4] = Field(4, description="Number of shifted grids whose surfaces are averaged")
    max_cells: int = Field(4_000_000, ge=1, le=1 << 28, description="Maximum number of cells of a grid")


class SimpleMorphologicalFilter(Interface[SimpleMorphologicalFilterConfig]):
    """SMRF [1]_ with an upper bound of the threshold [2]_, on several grids.

    The lowest points of the cells form a surface, which is opened by disks of growing radius. Cells that are
    higher than the opened surface by more than ``slope`` times the radius, or ``max_step_m``, are not ground.
    The ground is the surface through the other cells; a point is ground within ``tolerance_m`` of it, more on
    slopes.

    The lowest point of a cell depends on the position of its edges, so the surfaces of grids shifted by half
    a cell are averaged. The upper bound of the threshold excludes flat roofs of any height, for any radius.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the ground points; raises InputError if there are none or the cloud is too wide."""
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
        return Outputs(
            ground=ground.astype(np.int64), ground_points=given[ground], height_above_ground=above_m
        )

    def _ground_at(self, points: FloatArray, shift: tuple[float, float]) -> tuple[FloatArray, FloatArray]:
        """Return height and slope of the ground below each point ``(n,)``, from one grid."""
        cell_m = self.config.cell_m
        at = points[:, :2] / cell_m
        at -= np.floor(at.min(axis=0)) - np.asarray(shift)
        surface = self._ground(self._lowest(at.astype(np.int64), points[:, 2]))
        steepness = np.hypot(*_gradient(surface, cell_m))
        centre = (at - 0.5).T
        height, slope = (
            map_coordinates(grid, centre, order=1, mode="nearest") for grid in (surface, steepness)
        )
        return np.asarray(height), np.asarray(slope)

    def _lowest(self, cell: IntArray, z_m: FloatArray) -> FloatArray:
        """Return the grid of lowest heights, NaN where there is no point."""
        shape = tuple(int(n) + 1 for n in cell.max(axis=0))
        if shape[0] * shape[1] > self.config.max_cells:
            raise InputError(
                f"points: {shape[0]} x {shape[1]} cells of {self.config.cell_m} m, expected at most "
                f"max_cells={self.config.max_cells}; use larger cells or cut the cloud"
            )
        lowest = np.full(shape, np.inf)
        np.minimum.at(lowest, (cell[:, 0], cell[:, 1]), z_m)
        return np.where(np.isinf(lowest), np.nan, lowest)

    def _ground(self, lowest: FloatArray) -> FloatArray:
        """Return the surface through the cells without objects."""
        c = self.config
        whole = inpainted(lowest)
        outlier = _rises(-whole, [1], [_OUTLIER_SLOPE * c.cell_m])
        if outlier.any() and not outlier[np.isfinite(lowest)].all():
            whole = inpainted(np.where(outlier, np.nan, lowest))
        radii = range(1, max(1, int(np.ceil(c.window_m / c.cell_m))) + 1)
        thresholds = [min(c.slope * radius * c.cell_m, c.max_step_m) for radius in radii]
        bare = np.isfinite(lowest) & ~outlier & ~_rises(whole, radii, thresholds)
        return inpainted(np.where(bare, whole, np.nan)) if bare.any() else whole


def _rises(surface: FloatArray, radii: Sequence[int], thresholds_m: Sequence[float]) -> BoolArray:
    """Return the cells above the surface as opened successively by disks of growing radius, in cells."""
    level = float(surface.min())
    before = (surface - level).astype(np.float32)
    standing = np.zeros(surface.shape, dtype=np.bool_)
    for radius, threshold_m in zip(radii, thresholds_m, strict=True):
        opened = cv2.morphologyEx(before, cv2.MORPH_OPEN, _disk(radius), borderType=cv2.BORDER_REPLICATE)
        standing |= before - opened > threshold_m
        before = np.asarray(opened, np.float32)
    return standing


def _disk(radius: int) -> ByteArray:
    y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
    return np.asarray(x * x + y * y <= radius * radius, dtype=np.uint8)


def _gradient(surface: FloatArray, cell_m: float) -> list[FloatArray]:
    """Return the derivatives along both axes; 0 along an axis of one cell."""
    return [
        np.gradient(surface, cell_m, axis=axis) if surface.shape[axis] > 1 else np.zeros_like(surface)
        for axis in (0, 1)
    ]

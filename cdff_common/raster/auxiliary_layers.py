# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Auxiliary layers of an elevation map, in addition to the statistics of its heights, and their pooling.

``pose_variance`` mean variance that the poses add to the heights, m2 · ``error_variance`` variance of the
cell's mean as an estimate of the ground height, m2 · ``intensity`` mean intensity · ``first_age_s`` age of
the oldest measurement, seconds before the end of the map · ``overhang_m`` lowest height of an overhang above
the cell. All float32, NaN where unknown.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import NDArray

from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.statistics import CellStatistics

if TYPE_CHECKING:
    from cdff_common.types import ElevationMap

Grid = NDArray[np.float64]

#: Layers that are pooled; ``error_variance`` is computed from them and the statistics of the heights.
POOLED_LAYERS = ("pose_variance", "intensity", "first_age_s", "overhang_m")
#: Index of each pooled statistic in ``AuxiliaryLayers.sums``. The last two keep the minimum, the others add
#: up.
POSE_VARIANCE_SUM, INTENSITY_SUM, INTENSITY_COUNT, COUNT_SQUARES, AREA_SUM, X_SUM, Y_SUM = range(7)
FIRST_US, OVERHANG_M = 7, 8
_ADDED, _MINIMA = slice(0, 7), slice(7, 9)
_EMPTY = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, np.inf, np.inf])
#: Number of pooled statistics.
STATISTICS = len(_EMPTY)


@dataclass(slots=True, eq=False)
class AuxiliaryLayers:
    """Statistics of the auxiliary layers that can be pooled, for each cell of a grid.

    Attributes
    ----------
    geometry : GridGeometry
    sums : Grid, shape (rows, cols, 9)
        ``POSE_VARIANCE_SUM`` sum of the variances that the poses add to the heights, m2, NaN if that of any
        height is unknown; ``INTENSITY_SUM`` and ``INTENSITY_COUNT`` sum and number of the known intensities;
        ``COUNT_SQUARES`` sum of the squared numbers of heights of the cells of the maps, and ``AREA_SUM`` sum
        of their numbers of heights, each multiplied by the fraction of this cell that the map's cell covers;
        ``X_SUM`` and ``Y_SUM`` sums of the coordinates of the heights, metres in the frame of the grid, where
        each height counts with the centre of its map's cell;
        ``FIRST_US`` stamp of the oldest measurement, us, +inf if there is none, -inf if it is unknown;
        ``OVERHANG_M`` lowest height of an overhang, +inf if there is none.
    """

    geometry: GridGeometry
    sums: Grid

    @classmethod
    def empty(cls, geometry: GridGeometry) -> Self:
        """Return a grid without measurements."""
        rows = np.broadcast_to(np.tile(_EMPTY, geometry.cols), (geometry.rows, geometry.cols * len(_EMPTY)))
        return cls(geometry, rows.copy().reshape(*geometry.shape, len(_EMPTY)))

    @classmethod
    def unknown(cls, geometry: GridGeometry, observed: NDArray[np.bool_]) -> Self:
        """Return a grid whose ``observed`` cells have heights without auxiliary layers."""
        result = cls.empty(geometry)
        result.sums[observed, POSE_VARIANCE_SUM] = np.nan
        result.sums[observed, FIRST_US] = -np.inf
        return result

    @classmethod
    def of_map(cls, dem: ElevationMap) -> Self:
        """Return the statistics of a map's layers; absent layers contribute nothing.

        A cell is observed if its count is above 0 and its mean finite, as in ``CellStatistics.from_layers``.
        """
        result, names = cls.empty(dem.geometry), dem.layer_names
        sums = result.sums
        count = dem.layer("count").astype(np.float64)
        observed = np.isfinite(dem.layer("mean")) & (count > 0.0)
        count = np.where(observed, count, 0.0)
        if "pose_variance" in names:
            sums[..., POSE_VARIANCE_SUM] = (
                np.nan_to_num(dem.layer("pose_variance").astype(np.float64)) * count
            )
        if "intensity" in names:
            intensity = dem.layer("intensity").astype(np.float64)
            sums[..., INTENSITY_COUNT] = np.where(np.isfinite(intensity), count, 0.0)
            sums[..., INTENSITY_SUM] = np.nan_to_num(intensity) * sums[..., INTENSITY_COUNT]
        result.set_counts(count)
        age = dem.layer("first_age_s" if "first_age_s" in names else "age_s").astype(np.float64)
        is_dated = observed & np.isfinite(age)
        sums[..., FIRST_US] = np.where(is_dated, dem.t1_ns * 1e-3 - age * 1e6, np.inf)
        if "overhang_m" in names:
            overhang = dem.layer("overhang_m").astype(np.float64)
            sums[..., OVERHANG_M] = np.where(np.isfinite(overhang), overhang, np.inf)
        return result

    def set_counts(self, count: Grid) -> None:
        """Set the numbers of heights ``(rows, cols)`` of the cells of one map."""
        self.sums[..., COUNT_SQUARES], self.sums[..., AREA_SUM] = count * count, count
        self.sums[..., X_SUM] = count * self.geometry.x_centres_m()
        self.sums[..., Y_SUM] = count * self.geometry.y_centres_m()[:, None]

    def add(self, other: AuxiliaryLayers) -> None:
        """Pool another grid of the same cells into this one; cells outside this grid are ignored."""
        common = self.geometry.intersection(other.geometry)
        if common is None:
            return
        mine, theirs = (
            self.sums[self.geometry.slices_of(common)],
            other.sums[other.geometry.slices_of(common)],
        )
        mine[..., _ADDED] += theirs[..., _ADDED]
        np.minimum(mine[..., _MINIMA], theirs[..., _MINIMA], out=mine[..., _MINIMA])

    def minimum_at(self, statistic: int, cells: NDArray[np.int64], values: Grid) -> None:
        """Lower a statistic of flat cells ``(n,)`` to values ``(n,)`` where these are smaller."""
        np.minimum.at(self.sums.reshape(-1, len(_EMPTY))[:, statistic], cells, values)

    def window(self, geometry: GridGeometry) -> AuxiliaryLayers:
        """Return a copy in another window of the same cells."""
        result = AuxiliaryLayers.empty(geometry)
        result.add(self)
        return result

    def coarsened(self, factor: int) -> AuxiliaryLayers:
        """Return the statistics pooled into cells ``factor`` times as large."""
        result = AuxiliaryLayers.empty(self.geometry.coarsened(factor))
        down = result.geometry.top * factor - self.geometry.top
        right = self.geometry.left - result.geometry.left * factor
        row = (np.arange(self.geometry.rows) + down)[:, None] // factor
        col = (np.arange(self.geometry.cols) + right)[None, :] // factor
        np.add.at(result.sums[..., _ADDED], (row, col), self.sums[..., _ADDED])
        result.sums[..., AREA_SUM] /= factor * factor
        np.minimum.at(result.sums[..., _MINIMA], (row, col), self.sums[..., _MINIMA])
        return result

    def clear(self, cells: NDArray[np.bool_]) -> None:
        """Remove the measurements of cells ``(rows, cols)``."""
        self.sums[cells] = _EMPTY

    def to_layers(self, statistics: CellStatistics, t1_ns: int) -> dict[str, NDArray[np.float32]]:
        """Return the layers, given the height statistics of the same cells; unknown layers are omitted.

        The pose part of ``error_variance`` is common to all heights of a cell and does not decrease with
        their number. The remaining part decreases: the variance of the heights with their noise, and that of
        the relief within the cells of the maps, estimated by a plane through the neighbouring cells.

        The heights of a cell that is larger than those of the maps are a sample of clusters of different
        sizes, because the scan lines of a lidar cross only some of the maps' cells. The variance of their
        mean is that of the relief times ``sum(w^2) - a``, where w are the fractions of the heights in each of
        the maps' cells and a is the fraction of the cell that one of these covers (cluster sampling from a
        finite population: W. G. Cochran, Sampling Techniques, 3rd edition, 1977, chapters 2 and 9A).

        Scan lines that leave a part of the cell unobserved also displace the mean position of the heights
        from the centre of the cell. The mean height then differs from that of the cell by the slope times the
        displacement. Its square is added for the slope of a plane through the neighbouring cells, or for the
        mean slope to the neighbours in an unknown direction, whichever is larger.
        """
        from cdff_common.raster._auxiliary_kernels import fill_auxiliary, relief, sampling_errors

        squares = np.empty(self.geometry.shape)
        isolated = relief(statistics.count, statistics.mean, squares)
        known_squares = squares[np.isfinite(squares)] if isolated else squares[:0]
        typical = float(np.median(known_squares)) if known_squares.size else 0.0
        x_m, y_m = self.geometry.x_centres_m(), self.geometry.y_centres_m()
        displaced = np.empty(self.geometry.shape)
        sampling_errors(
            statistics.count,
            statistics.mean,
            self.sums,
            squares,
            typical,
            x_m,
            y_m,
            self.geometry.resolution_m,
            displaced,
        )
        stack = np.empty((5, *self.geometry.shape), dtype=np.float32)
        has_intensity, has_overhang = fill_auxiliary(
            statistics.count.reshape(-1),
            statistics.mean.reshape(-1),
            statistics.m2.reshape(-1),
            self.sums.reshape(-1, len(_EMPTY)),
            squares.reshape(-1),
            displaced.reshape(-1),
            typical,
            t1_ns * 1e-3,
            stack.reshape(5, -1),
        )
        layers = dict(zip(("pose_variance", "error_variance", "first_age_s"), stack[:3], strict=True))
        if has_intensity:
            layers["intensity"] = stack[3]
        if has_overhang:
            layers["overhang_m"] = stack[4]
        return layers

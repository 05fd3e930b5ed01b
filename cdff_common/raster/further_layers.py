# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Layers of an elevation map beyond the statistics of its heights, and how they pool.

``pose_variance`` mean variance that the poses put on the heights, m2 · ``error_variance`` variance of the cell's mean
as the height of the ground, m2 · ``intensity`` mean brightness · ``first_age_s`` age of the oldest measurement, seconds
before the map's end · ``overhang_m`` lowest height of what hangs over the cell. All float32, NaN where unknown.
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

#: Layers that the sums are made from; ``error_variance`` follows from them and the statistics of the heights.
SUMMED = ("pose_variance", "intensity", "first_age_s", "overhang_m")
SUMS = ("pose_m2", "brightness", "lit", "first_ns", "overhang")
#: ``first_ns`` of a cell without measurement, and of one whose oldest measurement is not known.
_NEVER_NS = np.iinfo(np.int64).max
_UNKNOWN_NS = np.iinfo(np.int64).min


@dataclass(slots=True, eq=False)
class FurtherLayers:
    """Sums that pool, arrays ``(rows, cols)``.

    Attributes
    ----------
    geometry : GridGeometry
    pose_m2 : Grid
        Sum of the variances that the poses put on the heights, square metres; NaN where that of some is not known.
    brightness, lit : Grid
        Sum of the brightnesses of the points that have one, and their number.
    first_ns : NDArray[np.int64]
        Stamp of the oldest measurement; the greatest number where there is none, the least where it is not known.
    overhang : Grid
        Lowest height of what hangs over the cell, metres; +inf where nothing does.
    """

    geometry: GridGeometry
    pose_m2: Grid
    brightness: Grid
    lit: Grid
    first_ns: NDArray[np.int64]
    overhang: Grid

    @classmethod
    def empty(cls, geometry: GridGeometry) -> Self:
        """Nothing known."""
        shape = geometry.shape
        return cls(
            geometry, np.zeros(shape), np.zeros(shape), np.zeros(shape), np.full(shape, _NEVER_NS, dtype=np.int64),
            np.full(shape, np.inf),
        )  # fmt: skip

    @classmethod
    def unknown(cls, geometry: GridGeometry, seen: NDArray[np.bool_]) -> Self:
        """Of the cells ``seen`` heights are known and nothing else; the others are empty."""
        made = cls.empty(geometry)
        made.pose_m2[seen], made.first_ns[seen] = np.nan, _UNKNOWN_NS
        return made

    @classmethod
    def of_map(cls, dem: ElevationMap) -> Self:
        """The sums behind a map's layers; a map of the six layers alone has none of the others."""
        made, names = cls.empty(dem.geometry), dem.layer_names
        count = np.nan_to_num(dem.layer("count").astype(np.float64))
        if "pose_variance" in names:
            made.pose_m2 = np.nan_to_num(dem.layer("pose_variance").astype(np.float64)) * count
        if "intensity" in names:
            brightness = dem.layer("intensity").astype(np.float64)
            made.lit = np.where(np.isfinite(brightness), count, 0.0)
            made.brightness = np.nan_to_num(brightness) * made.lit
        age = dem.layer("first_age_s" if "first_age_s" in names else "age_s").astype(np.float64)
        known = np.isfinite(age)
        made.first_ns[known] = dem.t1_ns - np.rint(age[known] * 1e9).astype(np.int64)
        if "overhang_m" in names:
            overhang = dem.layer("overhang_m").astype(np.float64)
            made.overhang = np.where(np.isfinite(overhang), overhang, np.inf)
        return made

    def add(self, other: FurtherLayers) -> None:
        """Pool another grid of the same cells into this one; what lies outside is left out."""
        common = self.geometry.intersection(other.geometry)
        if common is None:
            return
        mine, theirs = self.geometry.slices_of(common), other.geometry.slices_of(common)
        for name in ("pose_m2", "brightness", "lit"):
            getattr(self, name)[mine] += getattr(other, name)[theirs]
        np.minimum(self.first_ns[mine], other.first_ns[theirs], out=self.first_ns[mine])
        np.minimum(self.overhang[mine], other.overhang[theirs], out=self.overhang[mine])

    def window(self, geometry: GridGeometry) -> FurtherLayers:
        """A copy in another window of the same cells."""
        made = FurtherLayers.empty(geometry)
        made.add(self)
        return made

    def coarsened(self, factor: int) -> FurtherLayers:
        """Pooled into cells ``factor`` times as large."""
        made = FurtherLayers.empty(self.geometry.coarsened(factor))
        down = made.geometry.top * factor - self.geometry.top
        right = self.geometry.left - made.geometry.left * factor
        row = (np.arange(self.geometry.rows) + down)[:, None] // factor
        col = (np.arange(self.geometry.cols) + right)[None, :] // factor
        for name in ("pose_m2", "brightness", "lit"):
            np.add.at(getattr(made, name), (row, col), getattr(self, name))
        np.minimum.at(made.first_ns, (row, col), self.first_ns)
        np.minimum.at(made.overhang, (row, col), self.overhang)
        return made

    def forget(self, cells: NDArray[np.bool_]) -> None:
        """Unlearn cells ``(rows, cols)``."""
        for name, nothing in (
            ("pose_m2", 0.0), ("brightness", 0.0), ("lit", 0.0), ("first_ns", _NEVER_NS), ("overhang", np.inf)
        ):  # fmt: skip
            getattr(self, name)[cells] = nothing

    def to_layers(self, statistics: CellStatistics, t1_ns: int) -> dict[str, NDArray[np.float32]]:
        """The layers of the same cells, whose heights have these statistics; unknown ones are left out.

        The poses' part of ``error_variance`` is common to all heights of a cell and does not shrink with their number.
        The rest does: their spread with their noise, and the relief within the cell, that of a plane through its
        neighbours, which one height does not show and the differences to the neighbouring cells do.
        """
        from cdff_common.raster._further_kernels import fill_further, relief

        squares = np.empty(self.geometry.shape)
        alone = relief(statistics.count, statistics.mean, squares)
        known = squares[np.isfinite(squares)] if alone else squares[:0]
        typical = float(np.median(known)) if known.size else 0.0
        stack = np.empty((5, *self.geometry.shape), dtype=np.float32)
        fill_further(
            statistics.count.reshape(-1), statistics.mean.reshape(-1), statistics.m2.reshape(-1),
            self.pose_m2.reshape(-1), self.brightness.reshape(-1), self.lit.reshape(-1), self.first_ns.reshape(-1),
            self.overhang.reshape(-1), squares.reshape(-1), typical, t1_ns, stack.reshape(5, -1),
        )  # fmt: skip
        layers = dict(zip(("pose_variance", "error_variance", "first_age_s"), stack[:3], strict=True))
        if np.any(self.lit > 0):
            layers["intensity"] = stack[3]
        if np.any(np.isfinite(self.overhang)):
            layers["overhang_m"] = stack[4]
        return layers

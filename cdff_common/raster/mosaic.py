# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assembly of one elevation window from many maps: pooled or selected cell by cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import cos, isclose, radians
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.raster import _kernels
from cdff_common.raster._pooling import MapSource, WindowCells
from cdff_common.raster.auxiliary_layers import POOLED_LAYERS, AuxiliaryLayers
from cdff_common.raster.cell_selection import Choice, Disagreement
from cdff_common.raster.geometry import ALIGNMENT_TOLERANCE_CELLS, GridGeometry
from cdff_common.raster.statistics import ELEVATION_LAYERS, CellStatistics, checked_layers

#: Largest tilt between a resampled map and the window; beyond it, cells would occlude each other.
MAX_TILT_DEG = 30.0
#: Patches disagree if the standard deviation between them exceeds ``AGREED_M`` and this multiple of the
#: standard deviation within them, since two scans of rough ground never match exactly.
DISAGREE_SIGMA = 3.0
AGREED_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class AssembledWindow:
    """Result of the assembly.

    Attributes
    ----------
    statistics : CellStatistics
    auxiliary : AuxiliaryLayers or None
        Auxiliary layers of the same cells; None if no map has any, or none were requested.
    flagged : array of bool, shape (rows, cols)
        Cells in which maps disagreed, before the treatment of disagreement.
    """

    statistics: CellStatistics
    auxiliary: AuxiliaryLayers | None
    flagged: NDArray[np.bool_]

    @property
    def disagreeing(self) -> int:
        """Number of cells in which maps disagreed."""
        return int(np.count_nonzero(self.flagged))

    def to_layers(self, t1_ns: int) -> dict[str, NDArray[np.float32]]:
        """Return the layers ``ELEVATION_LAYERS``, then the auxiliary layers that are known in any cell."""
        layers = self.statistics.to_layers(t1_ns)
        if self.auxiliary is not None:
            auxiliary = self.auxiliary.to_layers(self.statistics, t1_ns)
            layers |= {name: layer for name, layer in auxiliary.items() if np.isfinite(layer).any()}
        return layers


class Mosaic:
    """Window that is assembled map by map.

    Parameters
    ----------
    geometry : GridGeometry
        Grid of the window; its cells are no smaller than those of any map.
    choice : Choice
    disagreement : Disagreement
        Treatment of disagreeing cells; only for pooled cells.
    auxiliary : bool
        Pool the auxiliary layers of maps that have them. In a cell that also contains heights without
        auxiliary layers they are unknown, except intensity and overhangs, which refer to the other heights.

    Attributes
    ----------
    patches : int
        Number of maps that overlap the window.
    """

    def __init__(
        self,
        geometry: GridGeometry,
        choice: Choice = Choice.POOLED,
        disagreement: Disagreement = Disagreement.KEEP,
        *,
        auxiliary: bool = False,
    ) -> None:
        if choice is not Choice.POOLED and disagreement is not Disagreement.KEEP:
            raise InputError(f"choice={choice}, disagreement={disagreement}: only pooled cells can disagree")
        self.geometry = geometry
        self.choice = choice
        self.disagreement = disagreement
        self.patches = 0
        self._cells = WindowCells(CellStatistics.empty(geometry))
        self._within = np.zeros(geometry.shape)
        self._newest = (
            WindowCells(CellStatistics.empty(geometry)) if disagreement is Disagreement.NEWEST else None
        )
        self._with_auxiliary = auxiliary

    def add(
        self,
        geometry: GridGeometry,
        layers: Mapping[str, ArrayLike],
        t1_ns: int,
        T_window_map: UncertainTransform | None = None,
    ) -> GridGeometry | None:
        """Add one map; return the part of the window that it can overlap, or None.

        A map in the window's frame whose cells fit into those of the window is pooled exactly. Any other map
        is resampled: its cells are divided into 2 x 2 parts with a quarter of the heights each, and a part is
        added to the cell that contains its centre, so that no height is lost or counted twice; see
        ``_kernels.pool_resampled``.

        Parameters
        ----------
        geometry, layers, t1_ns
            Grid, layers and end of capture of the map, see ``CellStatistics.from_layers``.
        T_window_map : UncertainTransform, optional
            Required if the map is in another frame. Its covariance adds to the variance of the heights.

        Raises
        ------
        InputError
            If a layer is missing or has another shape, cells are larger than the window's, a map of another
            frame has no transform, or a map is tilted by more than ``MAX_TILT_DEG``.
        """
        arrays = _arrays(geometry, layers, ELEVATION_LAYERS)
        if geometry.resolution_m > self.geometry.resolution_m * (1.0 + 1e-9):
            raise InputError(
                f"cells of {geometry.resolution_m} m do not fit into a window of "
                f"{self.geometry.resolution_m} m: "
                "coarser data are not resampled to finer cells"
            )
        factor = fitting_factor(geometry, self.geometry) if T_window_map is None else None
        if T_window_map is None and geometry.frame != self.geometry.frame:
            raise InputError(
                f"map in {geometry.frame}, window in {self.geometry.frame}: expected a transform"
            )
        overlap = self._overlap(geometry, factor, T_window_map, layers)
        if overlap is None:
            return None
        self.patches += 1
        source = MapSource(
            geometry, arrays, self._auxiliary_of(geometry, layers), t1_ns, factor, T_window_map
        )
        if self.choice is Choice.POOLED and self._newest is None and factor == 1:
            source.pool_into(self._cells, self._within)
            return overlap
        part = WindowCells(CellStatistics.empty(overlap))
        source.pool_into(part, np.zeros(overlap.shape))
        slices = self.geometry.slices_of(overlap)
        if self.choice is Choice.POOLED:
            self._cells.add(part)
            self._within[slices] += part.statistics.m2
        else:
            self._cells.select(slices, part, self.choice)
        if self._newest is not None:
            self._newest.select(slices, part, Choice.NEWEST)
        return overlap

    def copy_cells(self, other: Mosaic) -> None:
        """Copy the common cells of another mosaic with the same rules; none of them may have a height."""
        common = self.geometry.intersection(other.geometry)
        if common is None:
            return
        target, source = self.geometry.slices_of(common), other.geometry.slices_of(common)
        self._cells.copy(target, other._cells, source)
        self._within[target] = other._within[source]
        if self._newest is not None and other._newest is not None:
            self._newest.copy(target, other._newest, source)

    def disagreeing(self) -> tuple[NDArray[np.bool_], int]:
        """Return the pooled cells ``(rows, cols)`` whose patches disagree, and their number.

        See ``DISAGREE_SIGMA``.
        """
        is_flagged = np.zeros(self.geometry.shape, dtype=np.bool_)
        if self.choice is not Choice.POOLED:
            return is_flagged, 0
        cells = self._cells.statistics
        count, m2, within = (a.reshape(-1) for a in (cells.count, cells.m2, self._within))
        return is_flagged, _kernels.flag_disagreement(
            count, m2, within, DISAGREE_SIGMA, AGREED_M, is_flagged.reshape(-1)
        )

    def assembled(self) -> AssembledWindow:
        """Return the window after the treatment of disagreement."""
        is_flagged, count = self.disagreeing()
        cells = self._cells
        if count and self.disagreement is Disagreement.DROP:
            if cells.auxiliary is not None:
                cells.auxiliary.clear(is_flagged)
            return AssembledWindow(cells.statistics.masked(~is_flagged), cells.auxiliary, is_flagged)
        if count and self._newest is not None:
            cells.replace(self._newest, is_flagged)
        return AssembledWindow(cells.statistics, cells.auxiliary, is_flagged)

    def _auxiliary_of(
        self, geometry: GridGeometry, layers: Mapping[str, ArrayLike]
    ) -> tuple[Any, ...] | None:
        """Return the layers ``POOLED_LAYERS`` of a map, NaN for absent ones; None until some map has any."""
        if not self._with_auxiliary or (
            self._cells.auxiliary is None and not any(name in layers for name in POOLED_LAYERS)
        ):
            return None
        missing = [name for name in POOLED_LAYERS if name not in layers]
        if missing:
            unknown = np.full(geometry.shape, np.nan, dtype=np.float32)
            unknown.setflags(
                write=False
            )  # like the layers of messages, so that numba compiles one version only
            layers = {**layers, **dict.fromkeys(missing, unknown)}
        return _arrays(geometry, layers, POOLED_LAYERS)

    def _overlap(
        self,
        geometry: GridGeometry,
        factor: int | None,
        T: UncertainTransform | None,
        layers: Mapping[str, ArrayLike],
    ) -> GridGeometry | None:
        """Return the part of the window that a map can overlap, or None."""
        g, window = geometry, self.geometry
        if factor is not None:
            return g.coarsened(factor).intersection(window)
        if T is None:
            xmin, ymin, xmax, ymax = g.bounds
        else:
            if not is_level(T):
                raise InputError(
                    f"{g.frame} is tilted against {window.frame} by more than {MAX_TILT_DEG:g} deg"
                )
            heights = np.asarray(layers["mean"])
            known = heights[np.isfinite(heights)]
            if not known.size:
                return None
            xy = [(x, y) for x in (g.xmin_m, g.xmax_m) for y in (g.ymin_m, g.ymax_m)]
            corners = T.apply([(x, y, z) for x, y in xy for z in (float(known.min()), float(known.max()))])
            (xmin, ymin), (xmax, ymax) = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        r = window.resolution_m
        margin = 2.0 * ALIGNMENT_TOLERANCE_CELLS * r
        extended = (float(xmin) - margin, float(ymin) - margin, float(xmax) + margin, float(ymax) + margin)
        return GridGeometry.aligned(window.frame, r, extended).intersection(window)


def is_level(T_window_map: UncertainTransform) -> bool:
    """Return whether a map is tilted by at most ``MAX_TILT_DEG``, so that it can be resampled."""
    return bool(T_window_map.matrix[2, 2] >= cos(radians(MAX_TILT_DEG)))


def fitting_factor(fine: GridGeometry, window: GridGeometry) -> int | None:
    """Return the number of map cells along the edge of a window cell, or None if they do not fit."""
    factor = round(window.resolution_m / fine.resolution_m)
    fits = fine.frame == window.frame and factor >= 1
    return factor if fits and isclose(window.resolution_m, factor * fine.resolution_m, rel_tol=1e-6) else None


def _arrays(
    geometry: GridGeometry, layers: Mapping[str, ArrayLike], names: tuple[str, ...]
) -> tuple[NDArray[np.float32], ...]:
    """Return checked layers as float32 arrays."""
    arrays = checked_layers(geometry, layers, names)
    return tuple(np.asarray(arrays[name], dtype=np.float32) for name in names)

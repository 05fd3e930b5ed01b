# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One elevation window out of many maps: pooled, or by a choice in each cell, with a rule for what disagrees."""

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
from cdff_common.raster._pooling import Cells, Source
from cdff_common.raster.choice import Choice, Disagreement
from cdff_common.raster.further_layers import SUMMED, FurtherLayers
from cdff_common.raster.geometry import ALIGNMENT_TOLERANCE_CELLS, GridGeometry
from cdff_common.raster.statistics import ELEVATION_LAYERS, CellStatistics

#: A map that is tilted more against the window's vertical is not resampled: its cells would hide each other.
MAX_TILT_DEG = 30.0
#: Patches disagree where the spread between them is more than this many times the spread within them, and
#: ``AGREED_M``: two scans of rough ground never match exactly.
DISAGREE_SIGMA = 3.0
AGREED_M = 0.01


@dataclass(frozen=True, slots=True, eq=False)
class Assembled:
    """What came of the maps.

    Attributes
    ----------
    statistics : CellStatistics
    further : FurtherLayers or None
        Of the same cells; None where no map had any, or none were wanted.
    disagreeing : int
        Cells in which maps disagreed, before the rule for them.
    """

    statistics: CellStatistics
    further: FurtherLayers | None
    disagreeing: int

    def to_layers(self, t1_ns: int) -> dict[str, NDArray[np.float32]]:
        """The layers of contract §7, and after them those further ones that are known of a cell."""
        layers = self.statistics.to_layers(t1_ns)
        if self.further is not None:
            further = self.further.to_layers(self.statistics, t1_ns)
            layers |= {name: layer for name, layer in further.items() if np.isfinite(layer).any()}
        return layers


class Mosaic:
    """Assembles a window map by map.

    Parameters
    ----------
    geometry : GridGeometry
        The window; its cells are no smaller than any map's.
    choice : Choice
    disagreement : Disagreement
        Only where everything is pooled.
    further : bool
        Pool the layers beyond the six as well, where maps have them. What one map does not say of its heights is then
        unknown of the cell, but for intensity and overhangs: those are of the heights and maps that have them.

    Attributes
    ----------
    patches : int
        Maps that reached into the window.
    """

    def __init__(
        self, geometry: GridGeometry, choice: Choice = Choice.POOLED, disagreement: Disagreement = Disagreement.KEEP,
        *, further: bool = False,
    ) -> None:  # fmt: skip
        if choice is not Choice.POOLED and disagreement is not Disagreement.KEEP:
            raise InputError(f"choice={choice}, disagreement={disagreement}: only pooled cells can disagree")
        self.geometry = geometry
        self.choice = choice
        self.disagreement = disagreement
        self.patches = 0
        self._cells = Cells(CellStatistics.empty(geometry))
        self._within = np.zeros(geometry.shape)
        self._newest = Cells(CellStatistics.empty(geometry)) if disagreement is Disagreement.NEWEST else None
        self._wants_further = further

    def add(
        self, geometry: GridGeometry, layers: Mapping[str, ArrayLike], t1_ns: int,
        T_window_map: UncertainTransform | None = None,
    ) -> bool:  # fmt: skip
        """Take in one map; tell whether it reached into the window.

        A map in the window's frame whose cells fit into the window's is pooled exactly. Any other is resampled: its
        cells are cut into 2 x 2 parts with a quarter of the heights each, and a part falls into the cell that its
        centre lies in, so that no height is lost or counted twice; see ``_kernels.pool_moved``.

        Parameters
        ----------
        geometry, layers, t1_ns
            Of the map, as ``CellStatistics.from_layers`` takes them.
        T_window_map : UncertainTransform, optional
            Needed where the map is in another frame. Its covariance adds to the variance of the heights.

        Raises
        ------
        InputError
            If a layer is missing or has another shape, cells are larger than the window's, a map of another frame
            comes without transform, or one is tilted by more than ``MAX_TILT_DEG``.
        """
        arrays = _arrays(geometry, layers)
        if geometry.resolution_m > self.geometry.resolution_m * (1.0 + 1e-9):
            raise InputError(
                f"cells of {geometry.resolution_m} m do not fit into a window of {self.geometry.resolution_m} m: "
                "coarser data are never made finer"
            )
        factor = fitting_factor(geometry, self.geometry) if T_window_map is None else None
        if T_window_map is None and geometry.frame != self.geometry.frame:
            raise InputError(f"map in {geometry.frame}, window in {self.geometry.frame}: expected a transform")
        reach = self._reach(geometry, factor, T_window_map, layers)
        if reach is None:
            return False
        self.patches += 1
        source = Source(geometry, arrays, self._further_of(geometry, layers), t1_ns, factor, T_window_map)
        if self.choice is Choice.POOLED and self._newest is None and factor == 1:
            source.pool_into(self._cells, self._within)
            return True
        part = Cells(CellStatistics.empty(reach))
        source.pool_into(part, np.zeros(reach.shape))
        here = self.geometry.slices_of(reach)
        if self.choice is Choice.POOLED:
            self._cells.add(part)
            self._within[here] += part.statistics.m2
        else:
            self._cells.take(here, part, self.choice)
        if self._newest is not None:
            self._newest.take(here, part, Choice.NEWEST)
        return True

    def disagreeing(self) -> tuple[NDArray[np.bool_], int]:
        """Pooled cells ``(rows, cols)`` whose patches disagree (see ``DISAGREE_SIGMA``), and how many they are."""
        wrong = np.zeros(self.geometry.shape, dtype=np.bool_)
        if self.choice is not Choice.POOLED:
            return wrong, 0
        cells = self._cells.statistics
        count, m2, within = (a.reshape(-1) for a in (cells.count, cells.m2, self._within))
        return wrong, _kernels.disagreeing(count, m2, within, DISAGREE_SIGMA, AGREED_M, wrong.reshape(-1))

    def assembled(self) -> Assembled:
        """The window after its rule for disagreement."""
        wrong, count = self.disagreeing()
        cells = self._cells
        if count and self.disagreement is Disagreement.DROP:
            if cells.further is not None:
                cells.further.forget(wrong)
            return Assembled(cells.statistics.masked(~wrong), cells.further, count)
        if count and self._newest is not None:
            cells.replace(self._newest, wrong)
        return Assembled(cells.statistics, cells.further, count)

    def _further_of(self, geometry: GridGeometry, layers: Mapping[str, ArrayLike]) -> tuple[Any, ...] | None:
        """A map's further layers in the order of ``SUMMED``, NaN where it has none; None while no map has any."""
        if not self._wants_further or (self._cells.further is None and not any(name in layers for name in SUMMED)):
            return None
        missing = [name for name in SUMMED if name not in layers]
        if missing:
            unknown = np.full(geometry.shape, np.nan, dtype=np.float32)
            unknown.setflags(write=False)  # as the layers of messages: one type to the compiler
            layers = {**layers, **dict.fromkeys(missing, unknown)}
        return _checked(geometry, {name: layers[name] for name in SUMMED})

    def _reach(
        self, geometry: GridGeometry, factor: int | None, T: UncertainTransform | None,
        layers: Mapping[str, ArrayLike],
    ) -> GridGeometry | None:  # fmt: skip
        """The part of the window that a map can reach, None where it cannot."""
        g, window = geometry, self.geometry
        if factor is not None:
            return g.coarsened(factor).intersection(window)
        if T is None:
            xmin, ymin, xmax, ymax = g.bounds
        else:
            if not is_level(T):
                raise InputError(f"{g.frame} is tilted against {window.frame} by more than {MAX_TILT_DEG:g} deg")
            heights = np.asarray(layers["mean"])
            known = heights[np.isfinite(heights)]
            if not known.size:
                return None
            xy = [(x, y) for x in (g.xmin_m, g.xmax_m) for y in (g.ymin_m, g.ymax_m)]
            corners = T.apply([(x, y, z) for x, y in xy for z in (float(known.min()), float(known.max()))])
            (xmin, ymin), (xmax, ymax) = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        r = window.resolution_m
        slack = 2.0 * ALIGNMENT_TOLERANCE_CELLS * r
        wider = (float(xmin) - slack, float(ymin) - slack, float(xmax) + slack, float(ymax) + slack)
        return GridGeometry.aligned(window.frame, r, wider).intersection(window)


def is_level(T_window_map: UncertainTransform) -> bool:
    """Whether a map is tilted by no more than ``MAX_TILT_DEG``, so that it can be resampled."""
    return bool(T_window_map.matrix[2, 2] >= cos(radians(MAX_TILT_DEG)))


def fitting_factor(fine: GridGeometry, window: GridGeometry) -> int | None:
    """How many cells of a map make one of the window along an edge; None where they do not fit."""
    factor = round(window.resolution_m / fine.resolution_m)
    fits = fine.frame == window.frame and factor >= 1
    return factor if fits and isclose(window.resolution_m, factor * fine.resolution_m, rel_tol=1e-6) else None


def _arrays(geometry: GridGeometry, layers: Mapping[str, ArrayLike]) -> tuple[Any, ...]:
    missing = [name for name in ELEVATION_LAYERS if name not in layers]
    if missing:
        raise InputError(f"elevation map without layer {missing[0]!r}; expected {', '.join(ELEVATION_LAYERS)}")
    return _checked(geometry, {name: layers[name] for name in ELEVATION_LAYERS})


def _checked(geometry: GridGeometry, layers: Mapping[str, ArrayLike]) -> tuple[Any, ...]:
    arrays = {name: np.asarray(layer, dtype=np.float32) for name, layer in layers.items()}
    for name, array in arrays.items():
        if array.shape != geometry.shape:
            raise InputError(f"layer {name}: shape {array.shape}, expected {geometry.shape}")
    return tuple(arrays.values())

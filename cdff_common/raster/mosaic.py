# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One elevation window out of many maps: pooled, or by a choice in each cell, with a rule for what disagrees."""

from __future__ import annotations

from collections.abc import Mapping
from math import cos, isclose, radians
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.raster import _kernels
from cdff_common.raster.choice import Choice, Disagreement
from cdff_common.raster.geometry import ALIGNMENT_TOLERANCE_CELLS, GridGeometry
from cdff_common.raster.statistics import ELEVATION_LAYERS, CellStatistics

#: A map that is tilted more against the window's vertical is not resampled: its cells would hide each other.
MAX_TILT_DEG = 30.0
#: Patches disagree where the spread between them is more than this many times the spread within them, and
#: ``AGREED_M``: two scans of rough ground never match exactly.
DISAGREE_SIGMA = 3.0
AGREED_M = 0.01

_NO_COVARIANCE = np.zeros((6, 6))


class Mosaic:
    """Assembles a window map by map.

    Parameters
    ----------
    geometry : GridGeometry
        The window; its cells are no smaller than any map's.
    choice : Choice
    disagreement : Disagreement
        Only where everything is pooled.

    Attributes
    ----------
    patches : int
        Maps that reached into the window.
    """

    def __init__(
        self, geometry: GridGeometry, choice: Choice = Choice.POOLED, disagreement: Disagreement = Disagreement.KEEP
    ) -> None:
        if choice is not Choice.POOLED and disagreement is not Disagreement.KEEP:
            raise InputError(f"choice={choice}, disagreement={disagreement}: only pooled cells can disagree")
        self.geometry = geometry
        self.choice = choice
        self.disagreement = disagreement
        self.patches = 0
        self._cells = CellStatistics.empty(geometry)
        self._within = np.zeros(geometry.shape)
        self._newest = CellStatistics.empty(geometry) if disagreement is Disagreement.NEWEST else None

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
        if self.choice is Choice.POOLED and self._newest is None and factor == 1:
            self._pool(self._cells, self._within, geometry, arrays, t1_ns, factor, T_window_map)
            return True
        part = CellStatistics.empty(reach)
        self._pool(part, np.zeros(reach.shape), geometry, arrays, t1_ns, factor, T_window_map)
        here = self.geometry.slices_of(reach)
        if self.choice is Choice.POOLED:
            self._cells.add(part)
            self._within[here] += part.m2
        else:
            _take(self._cells, here, part, self.choice)
        if self._newest is not None:
            _take(self._newest, here, part, Choice.NEWEST)
        return True

    def disagreeing(self) -> tuple[NDArray[np.bool_], int]:
        """Pooled cells ``(rows, cols)`` whose patches disagree (see ``DISAGREE_SIGMA``), and how many they are."""
        wrong = np.zeros(self.geometry.shape, dtype=np.bool_)
        if self.choice is not Choice.POOLED:
            return wrong, 0
        count, m2, within = (a.reshape(-1) for a in (self._cells.count, self._cells.m2, self._within))
        return wrong, _kernels.disagreeing(count, m2, within, DISAGREE_SIGMA, AGREED_M, wrong.reshape(-1))

    def statistics(self) -> tuple[CellStatistics, int]:
        """The window after its rule for disagreement, and how many cells disagreed."""
        wrong, count = self.disagreeing()
        if count and self.disagreement is Disagreement.DROP:
            return self._cells.masked(~wrong), count
        if count and self._newest is not None:
            for name in ("count", "mean", "m2", "minimum", "maximum", "newest_ns"):
                np.copyto(getattr(self._cells, name), getattr(self._newest, name), where=wrong)
        return self._cells, count

    def _pool(
        self, into: CellStatistics, within: NDArray[np.float64], geometry: GridGeometry, arrays: tuple[Any, ...],
        t1_ns: int, factor: int | None, T: UncertainTransform | None,
    ) -> None:  # fmt: skip
        window = into.geometry
        cells = (into.count, into.mean, into.m2, into.minimum, into.maximum, into.newest_ns, within)
        if factor is not None:
            down, right = window.top * factor - geometry.top, geometry.left - window.left * factor
            _kernels.pool_layers(arrays, t1_ns, factor, down, right, *cells)
            return
        matrix = np.eye(4) if T is None else np.ascontiguousarray(T.matrix)
        known = T is not None and T.covariance is not None
        covariance = np.ascontiguousarray(T.covariance) if known else _NO_COVARIANCE  # type: ignore[union-attr]
        _kernels.pool_moved(
            arrays, t1_ns, geometry.resolution_m, geometry.left, geometry.top, matrix, covariance, window.resolution_m,
            window.left, window.top, *cells,
        )  # fmt: skip

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
    arrays = tuple(np.asarray(layers[name], dtype=np.float32) for name in ELEVATION_LAYERS)
    for name, array in zip(ELEVATION_LAYERS, arrays, strict=True):
        if array.shape != geometry.shape:
            raise InputError(f"layer {name}: shape {array.shape}, expected {geometry.shape}")
    return arrays


def _take(into: CellStatistics, here: tuple[slice, slice], part: CellStatistics, choice: Choice) -> None:
    """Let the cells of a part replace those that it is chosen over."""
    if choice is Choice.NEWEST:
        better = part.newest_ns >= into.newest_ns[here]
    elif choice is Choice.OLDEST:
        better = (into.count[here] == 0) | (part.newest_ns < into.newest_ns[here])
    else:
        better = (into.count[here] == 0) | (_certainty(part) < _certainty(into, here))
    better &= part.count > 0
    for name in ("count", "mean", "m2", "minimum", "maximum", "newest_ns"):
        np.copyto(getattr(into, name)[here], getattr(part, name), where=better)


def _certainty(cells: CellStatistics, here: Any = ...) -> NDArray[np.float64]:
    """Variance to compare by: of one height without a variance of its own nothing is known."""
    count, m2 = cells.count[here], cells.m2[here]
    variance = m2 / np.where(count > 0, count, 1.0)
    return np.where((count <= 1.0) & (m2 == 0.0), np.inf, variance)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One navigation map out of many: what a cell holds is one map's judgement, never a mixture of several.

A judgement (class, cost, slope …) was made from all elevation known at its time, by the limits of one rover: pooling
them as measurements are pooled would make a caution out of a safe cell and a hazard. So of several maps that know a
cell one is chosen; of several cells of one map that become one, the worst of each layer counts.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.raster.choice import NavigationChoice
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.mosaic import fitting_factor
from cdff_common.raster.resample import largest_of_blocks

#: The layer that says what is known: 0 unknown, 1 safe, 2 caution, 3 hazard.
CLASS = "class"
_WORST_CLASS = 3

Layers = dict[str, NDArray[Any]]


class NavigationMosaic:
    """Assembles a window, map by map, the oldest first.

    Parameters
    ----------
    geometry : GridGeometry
        The window; its cells are no smaller than any map's.
    choice : NavigationChoice

    Attributes
    ----------
    differing : array of bool, shape (rows, cols)
        Cells of which maps name different classes.
    """

    def __init__(self, geometry: GridGeometry, choice: NavigationChoice = NavigationChoice.NEWEST) -> None:
        self.geometry = geometry
        self.choice = choice
        self.differing = np.zeros(geometry.shape, dtype=np.bool_)
        self._classes = np.zeros(geometry.shape, dtype=np.uint8)
        self._values: Layers = {}

    def add(
        self, geometry: GridGeometry, layers: Mapping[str, NDArray[Any]], T_window_map: UncertainTransform | None = None
    ) -> bool:
        """Take in one map; tell whether it reached into the window.

        A map whose cells fit into the window's is coarsened, the worst cell of each block counting. Of any other the
        cells are cut into 2 x 2 parts, and a part falls into the cell that its centre lies in.

        Parameters
        ----------
        layers : mapping of str to array, shape (rows, cols)
            ``class``, and float layers with NaN for unknown.
        T_window_map : UncertainTransform, optional
            Needed where the map is in another frame.

        Raises
        ------
        InputError
            If there is no layer ``class``, or the cells are larger than the window's.
        """
        if CLASS not in layers:
            raise InputError(f"navigation map without layer {CLASS!r}: there are {', '.join(layers)}")
        if geometry.resolution_m > self.geometry.resolution_m * (1.0 + 1e-9):
            raise InputError(f"cells of {geometry.resolution_m} m in a window of {self.geometry.resolution_m} m")
        factor = fitting_factor(geometry, self.geometry) if T_window_map is None else None
        if factor is not None:
            part, where = largest_of_blocks(layers, geometry, factor)
            common = where.intersection(self.geometry)
            if common is None:
                return False
            cut, here = where.slices_of(common), self.geometry.slices_of(common)
            self._take(here, {name: layer[cut] for name, layer in part.items()})
            return True
        moved = self._moved(geometry, layers, T_window_map)
        if moved is None:
            return False
        self._take((slice(None), slice(None)), moved)
        return True

    def layers(self) -> Layers:
        """``class`` uint8 and float32 layers ``(rows, cols)``; a cell of class 0 has NaN in the others."""
        return {CLASS: self._classes, **self._values}

    def _take(self, here: tuple[slice, slice], part: Layers) -> None:
        new, old = np.minimum(part[CLASS], _WORST_CLASS).astype(np.uint8), self._classes[here]
        known = new > 0
        self.differing[here] |= known & (old > 0) & (old != new)
        if self.choice is NavigationChoice.WORST:
            taken = new > old
        else:
            taken = known if self.choice is NavigationChoice.NEWEST else known & (old == 0)
        for name in (self._values.keys() | part.keys()) - {CLASS}:
            values = self._values.setdefault(name, np.full(self.geometry.shape, np.nan, dtype=np.float32))[here]
            given = part.get(name, np.full(new.shape, np.nan, dtype=np.float32))
            if self.choice is NavigationChoice.WORST:
                np.fmax(values, given, out=values, where=known)
            else:
                np.copyto(values, given, where=taken, casting="same_kind")
        np.copyto(old, new, where=taken)

    def _moved(
        self, geometry: GridGeometry, layers: Mapping[str, NDArray[Any]], T: UncertainTransform | None
    ) -> Layers | None:
        """Layers of the window's shape with the worst of what falls into each cell; None where nothing does."""
        rows, cols = np.nonzero(layers[CLASS])
        quarters = np.array([[i, j] for i in (-0.25, 0.25) for j in (-0.25, 0.25)]) * geometry.resolution_m
        centres = np.column_stack([geometry.x_centres_m()[cols], geometry.y_centres_m()[rows]])
        parts = (centres[:, None, :] + quarters).reshape(-1, 2)
        points = np.column_stack([parts, np.zeros(len(parts))])
        if T is not None:
            points = T.apply(points)
        w = self.geometry
        column = np.floor((points[:, 0] - w.xmin_m) / w.resolution_m).astype(np.int64)
        row = np.floor((w.ymax_m - points[:, 1]) / w.resolution_m).astype(np.int64)
        inside = (column >= 0) & (column < w.cols) & (row >= 0) & (row < w.rows)
        if not inside.any():
            return None
        cell, source = row[inside] * w.cols + column[inside], np.repeat(np.arange(len(rows)), 4)[inside]
        made: Layers = {}
        for name, layer in layers.items():
            values = layer[rows, cols][source]
            if name == CLASS:
                found = np.zeros(w.rows * w.cols, dtype=np.uint8)
                np.maximum.at(found, cell, values.astype(np.uint8))
            else:
                found = np.full(w.rows * w.cols, np.nan, dtype=np.float32)
                np.fmax.at(found, cell, values.astype(np.float32))
            made[name] = found.reshape(w.shape)
        return made

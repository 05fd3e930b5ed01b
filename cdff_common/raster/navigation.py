# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assembly of one navigation map from many: a cell holds the assessment of one map, never a mixture.

An assessment (class, cost, slope …) is based on the elevation known at its time and the limits of one rover;
pooling them like measurements would turn a safe cell and a hazard into a caution. Therefore one of several
maps is selected for each cell; if several cells of one map become one, the worst value of each layer is used.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.raster.cell_selection import NavigationChoice
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.mosaic import fitting_factor
from cdff_common.raster.resample import largest_of_blocks

#: Layer of the class: 0 unknown, 1 safe, 2 caution, 3 hazard.
CLASS = "class"
_WORST_CLASS = 3

Layers = dict[str, NDArray[Any]]


class NavigationMosaic:
    """Window that is assembled map by map, oldest first.

    Parameters
    ----------
    geometry : GridGeometry
        Grid of the window; its cells are no smaller than those of any map.
    choice : NavigationChoice

    Attributes
    ----------
    differing : array of bool, shape (rows, cols)
        Cells to which maps assign different classes.
    """

    def __init__(self, geometry: GridGeometry, choice: NavigationChoice = NavigationChoice.NEWEST) -> None:
        self.geometry = geometry
        self.choice = choice
        self.differing = np.zeros(geometry.shape, dtype=np.bool_)
        self._classes = np.zeros(geometry.shape, dtype=np.uint8)
        self._values: Layers = {}

    def add(
        self,
        geometry: GridGeometry,
        layers: Mapping[str, NDArray[Any]],
        T_window_map: UncertainTransform | None = None,
    ) -> bool:
        """Add one map; return whether it overlaps the window.

        A map whose cells fit into those of the window is coarsened to the worst cell of each block. The cells
        of any other map are divided into 2 x 2 parts, and a part is added to the cell that contains its
        centre.

        Parameters
        ----------
        layers : mapping of str to array, shape (rows, cols)
            ``class``, and float layers with NaN for unknown.
        T_window_map : UncertainTransform, optional
            Required if the map is in another frame.

        Raises
        ------
        InputError
            If there is no layer ``class``, or the cells are larger than the window's.
        """
        if CLASS not in layers:
            raise InputError(f"navigation map without layer {CLASS!r}: it has {', '.join(layers)}")
        if geometry.resolution_m > self.geometry.resolution_m * (1.0 + 1e-9):
            raise InputError(
                f"cells of {geometry.resolution_m} m in a window of {self.geometry.resolution_m} m"
            )
        factor = fitting_factor(geometry, self.geometry) if T_window_map is None else None
        if factor is not None:
            coarse, coarse_geometry = largest_of_blocks(layers, geometry, factor)
            common = coarse_geometry.intersection(self.geometry)
            if common is None:
                return False
            source, target = coarse_geometry.slices_of(common), self.geometry.slices_of(common)
            self._merge(target, {name: layer[source] for name, layer in coarse.items()})
            return True
        resampled = self._resample_worst(geometry, layers, T_window_map)
        if resampled is None:
            return False
        self._merge((slice(None), slice(None)), resampled)
        return True

    def layers(self) -> Layers:
        """Return ``class`` (uint8, 0 if unknown) and float32 layers ``(rows, cols)``, NaN if unknown."""
        return {CLASS: self._classes, **self._values}

    def _merge(self, target: tuple[slice, slice], part: Layers) -> None:
        """Copy the selected cells into the slices ``target`` of the window; mark cells of differing class."""
        new, old = np.minimum(part[CLASS], _WORST_CLASS).astype(np.uint8), self._classes[target]
        known = new > 0
        self.differing[target] |= known & (old > 0) & (old != new)
        if self.choice is NavigationChoice.WORST:
            selected = new > old
        else:
            selected = known if self.choice is NavigationChoice.NEWEST else known & (old == 0)
        for name in (self._values.keys() | part.keys()) - {CLASS}:
            values = self._values.setdefault(name, np.full(self.geometry.shape, np.nan, dtype=np.float32))[
                target
            ]
            new_values = part.get(name, np.full(new.shape, np.nan, dtype=np.float32))
            if self.choice is NavigationChoice.WORST:
                np.fmax(values, new_values, out=values, where=known)
            else:
                np.copyto(values, new_values, where=selected, casting="same_kind")
        np.copyto(old, new, where=selected)

    def _resample_worst(
        self, geometry: GridGeometry, layers: Mapping[str, NDArray[Any]], T: UncertainTransform | None
    ) -> Layers | None:
        """Return layers of the window's shape with the worst value in each cell; None if no cell is
        covered.
        """
        rows, cols = np.nonzero(layers[CLASS])
        quarters = np.array([[i, j] for i in (-0.25, 0.25) for j in (-0.25, 0.25)]) * geometry.resolution_m
        centres = np.column_stack([geometry.x_centres_m()[cols], geometry.y_centres_m()[rows]])
        parts = (centres[:, None, :] + quarters).reshape(-1, 2)
        points = np.column_stack([parts, np.zeros(len(parts))])
        if T is not None:
            points = T.apply(points)
        window = self.geometry
        column = np.floor((points[:, 0] - window.xmin_m) / window.resolution_m).astype(np.int64)
        row = np.floor((window.ymax_m - points[:, 1]) / window.resolution_m).astype(np.int64)
        inside = (column >= 0) & (column < window.cols) & (row >= 0) & (row < window.rows)
        if not inside.any():
            return None
        cell, source = row[inside] * window.cols + column[inside], np.repeat(np.arange(len(rows)), 4)[inside]
        resampled: Layers = {}
        for name, layer in layers.items():
            values = layer[rows, cols][source]
            if name == CLASS:
                cell_values = np.zeros(window.rows * window.cols, dtype=np.uint8)
                np.maximum.at(cell_values, cell, values.astype(np.uint8))
            else:
                cell_values = np.full(window.rows * window.cols, np.nan, dtype=np.float32)
                np.fmax.at(cell_values, cell, values.astype(np.float32))
            resampled[name] = cell_values.reshape(window.shape)
        return resampled

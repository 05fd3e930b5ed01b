# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Incremental rating: only cells affected by a change of the elevation map are rated again."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap

Mask = NDArray[np.bool_]
Window = tuple[slice, slice]

#: Layers of the elevation map that determine the rating.
_RATED_LAYERS = ("mean", "variance", "overhang_m")
#: Fraction of affected cells above which rating the whole map is cheaper.
_MAX_PARTIAL = 0.5


def update_rating(
    dem: ElevationMap,
    previous: tuple[ElevationMap, NavigationMap] | None,
    reach_m: float,
    rate: Callable[[ElevationMap], NavigationMap],
) -> NavigationMap:
    """Return the rating of an elevation map, copied from the previous rating where nothing has changed.

    ``previous`` is the previous elevation map with its rating, which is not used if its cell size or frame
    differs. ``reach_m`` is the distance over which the height of a cell affects the rating of others.
    """
    geometry = dem.geometry
    common = None
    if previous is not None and previous[0].geometry.shares_cells_with(geometry):
        common = geometry.intersection(previous[0].geometry)
    if previous is None or common is None:
        return rate(dem)
    cells = int(np.ceil(reach_m / geometry.resolution_m)) + 1
    affected = _dilate(_changed_cells(dem, previous[0], common), cells)
    if affected.mean() > _MAX_PARTIAL:
        return rate(dem)
    previous_dem, previous_rating = previous
    in_new, in_previous = geometry.slices_of(common), previous_dem.geometry.slices_of(common)
    layers = {}
    for name in previous_rating.layer_names:
        layer = previous_rating.layer(name)
        layers[name] = np.full(geometry.shape, 0 if name == "class" else np.nan, layer.dtype)
        layers[name][in_new] = layer[in_previous]
    for box in _boxes(affected):
        window = _enlarge_box(box, cells, geometry)
        box_in_window = tuple(
            slice(b.start - w.start, b.stop - w.start) for b, w in zip(box, window, strict=True)
        )
        rated = rate(_crop(dem, window))
        for name in layers:
            layers[name][box] = rated.layer(name)[box_in_window]
    return NavigationMap.from_layers(geometry, layers, t0_ns=dem.t0_ns, t1_ns=dem.t1_ns)


def _changed_cells(dem: ElevationMap, previous: ElevationMap, common: GridGeometry) -> Mask:
    """Return the mask of cells that are new or changed, or at an edge beyond which cells were removed."""
    geometry, old = dem.geometry, previous.geometry
    in_new, in_previous = geometry.slices_of(common), old.slices_of(common)
    is_changed: Mask = np.isfinite(dem.layer("mean"))
    same = np.ones(common.shape, dtype=np.bool_)
    for name in _RATED_LAYERS:
        a, b = _layer(dem, name)[in_new], _layer(previous, name)[in_previous]
        same &= (a == b) | (np.isnan(a) & np.isnan(b))
    is_changed[in_new] = ~same
    for side, is_cut_off in (
        (np.s_[0, :], old.top > geometry.top),
        (np.s_[-1, :], old.top - old.rows < geometry.top - geometry.rows),
        (np.s_[:, 0], old.left < geometry.left),
        (np.s_[:, -1], old.left + old.cols > geometry.left + geometry.cols),
    ):
        if is_cut_off:
            is_changed[side] = True
    # Beyond the border of the previous map no cell counted as a hole. Where this border is now inside the
    # map, unobserved cells beyond it are holes: the cells at the border are rated again.
    rows, cols = in_new
    for side, is_inside in (
        (np.s_[rows.start, cols], rows.start > 0),
        (np.s_[rows.stop - 1, cols], rows.stop < geometry.rows),
        (np.s_[rows, cols.start], cols.start > 0),
        (np.s_[rows, cols.stop - 1], cols.stop < geometry.cols),
    ):
        if is_inside:
            is_changed[side] = True
    return is_changed


def _layer(dem: ElevationMap, name: str) -> NDArray[np.float32]:
    """Return a layer; NaN if the map does not have it (no overhangs)."""
    return dem.layer(name) if name in dem.layer_names else np.full(dem.geometry.shape, np.nan, np.float32)


def _dilate(changed: Mask, cells: int) -> Mask:
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * cells + 1, 2 * cells + 1))
    return np.asarray(cv2.dilate(changed.astype(np.uint8), square), dtype=np.bool_)


def _boxes(affected: Mask) -> Iterator[Window]:
    """Yield the bounding box of each group of connected affected cells."""
    count, _, boxes, _ = cv2.connectedComponentsWithStats(affected.astype(np.uint8), connectivity=8)
    for left, top, width, height, _ in boxes[1:count]:
        yield slice(int(top), int(top + height)), slice(int(left), int(left + width))


def _enlarge_box(box: Window, cells: int, geometry: GridGeometry) -> Window:
    """Return a box enlarged by a number of cells on each side, within the map."""
    rows, cols = (
        slice(max(p.start - cells, 0), min(p.stop + cells, n))
        for p, n in zip(box, geometry.shape, strict=True)
    )
    return rows, cols


def _crop(dem: ElevationMap, box: Window) -> ElevationMap:
    """Return the part of an elevation map in a box, with the layers that determine the rating."""
    rows, cols = box
    g = dem.geometry
    geometry = GridGeometry.from_cells(
        g.frame,
        g.resolution_m,
        left=g.left + cols.start,
        top=g.top - rows.start,
        rows=rows.stop - rows.start,
        cols=cols.stop - cols.start,
    )
    layers = {name: dem.layer(name)[box] for name in _RATED_LAYERS if name in dem.layer_names}
    return ElevationMap.from_layers(geometry, layers, t0_ns=dem.t0_ns, t1_ns=dem.t1_ns)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rate again only what a change of the elevation map reaches."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.raster import GridGeometry
from cdff_common.types import ElevationMap, NavigationMap

Mask = NDArray[np.bool_]
Window = tuple[slice, slice]

#: Layers of the elevation map that decide the rating.
_DECISIVE = ("mean", "variance", "overhang_m")
#: Above this share of the map it is cheaper to rate it whole.
_MOST = 0.5


def rated(
    dem: ElevationMap,
    before: tuple[ElevationMap, NavigationMap] | None,
    reach_m: float,
    rate: Callable[[ElevationMap], NavigationMap],
) -> NavigationMap:
    """The rating of a map, taken from the last one where nothing within reach has changed.

    Parameters
    ----------
    dem : ElevationMap
    before : tuple of ElevationMap and NavigationMap, optional
        The last elevation map and its rating; another cell size or frame means there is none.
    reach_m : float
        How far a cell's height bears on the rating of others.
    rate : callable
        Of a whole elevation map.
    """
    geometry = dem.geometry
    common = None
    if before is not None and before[0].geometry.shares_cells_with(geometry):
        common = geometry.intersection(before[0].geometry)
    if before is None or common is None:
        return rate(dem)
    cells = int(np.ceil(reach_m / geometry.resolution_m)) + 1
    stale = _reached(_changed(dem, before[0], common), cells)
    if stale.mean() > _MOST:
        return rate(dem)
    here, there = geometry.slices_of(common), before[0].geometry.slices_of(common)
    layers = {}
    for name in before[1].layer_names:
        old = before[1].layer(name)
        layers[name] = np.full(geometry.shape, 0 if name == "class" else np.nan, old.dtype)
        layers[name][here] = old[there]
    for part in _parts(stale):
        around = _grown(part, cells, geometry)
        window = _window(dem, around)
        inner = tuple(slice(p.start - a.start, p.stop - a.start) for p, a in zip(part, around, strict=True))
        made = rate(window)
        for name in layers:
            layers[name][part] = made.layer(name)[inner]
    return NavigationMap.from_layers(geometry, layers, t0_ns=dem.t0_ns, t1_ns=dem.t1_ns)


def _changed(dem: ElevationMap, before: ElevationMap, common: GridGeometry) -> Mask:
    """Cells that are not what they were: new, lost, or at an edge over which something was lost."""
    geometry = dem.geometry
    here, there = geometry.slices_of(common), before.geometry.slices_of(common)
    changed = np.isfinite(dem.layer("mean"))
    same = np.ones(common.shape, dtype=np.bool_)
    for name in _DECISIVE:
        a, b = _layer(dem, name)[here], _layer(before, name)[there]
        same &= (a == b) | (np.isnan(a) & np.isnan(b))
    changed[here] = ~same
    old = before.geometry
    for side, moved in (
        (np.s_[0, :], old.top > geometry.top), (np.s_[-1, :], old.top - old.rows < geometry.top - geometry.rows),
        (np.s_[:, 0], old.left < geometry.left), (np.s_[:, -1], old.left + old.cols > geometry.left + geometry.cols),
    ):  # fmt: skip
        if moved:
            changed[side] = True
    # What was an edge of the old window had no neighbours beyond it: unobserved ones count as holes now.
    rows, cols = here
    for side, inner in (
        (np.s_[rows.start, cols], rows.start > 0), (np.s_[rows.stop - 1, cols], rows.stop < geometry.rows),
        (np.s_[rows, cols.start], cols.start > 0), (np.s_[rows, cols.stop - 1], cols.stop < geometry.cols),
    ):  # fmt: skip
        if inner:
            changed[side] = True
    return changed


def _layer(dem: ElevationMap, name: str) -> NDArray[np.float32]:
    """A layer, NaN where the map has none of that name: no overhang is known of it then."""
    return dem.layer(name) if name in dem.layer_names else np.full(dem.geometry.shape, np.nan, np.float32)


def _reached(changed: Mask, cells: int) -> Mask:
    square = cv2.getStructuringElement(cv2.MORPH_RECT, (2 * cells + 1, 2 * cells + 1))
    return np.asarray(cv2.dilate(changed.astype(np.uint8), square) > 0)


def _parts(stale: Mask) -> Iterator[Window]:
    """Boxes around the connected stale cells."""
    count, _, boxes, _ = cv2.connectedComponentsWithStats(stale.astype(np.uint8), connectivity=8)
    for left, top, width, height, _ in boxes[1:count]:
        yield slice(int(top), int(top + height)), slice(int(left), int(left + width))


def _grown(part: Window, cells: int, geometry: GridGeometry) -> Window:
    rows, cols = (
        slice(max(p.start - cells, 0), min(p.stop + cells, n)) for p, n in zip(part, geometry.shape, strict=True)
    )
    return rows, cols


def _window(dem: ElevationMap, part: Window) -> ElevationMap:
    rows, cols = part
    g = dem.geometry
    inner = GridGeometry.from_cells(
        g.frame, g.resolution_m, left=g.left + cols.start, top=g.top - rows.start, rows=rows.stop - rows.start,
        cols=cols.stop - cols.start,
    )  # fmt: skip
    layers = {name: dem.layer(name)[part] for name in _DECISIVE if name in dem.layer_names}
    return ElevationMap.from_layers(inner, layers, t0_ns=dem.t0_ns, t1_ns=dem.t1_ns)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cells of maps for tiles: of a state of the maps, of an analysis of them, and of a coarser level where finer
cells do not exist.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.rendering import contour_cells
from cdff_common.raster.tiles import LAST_LEVEL, cell_m, level_of
from cdff_common.raster.viewshed import EDGE_CELLS, viewshed
from dpm_store import Query, Store
from dpm_store.maps.tile_queries import tile_query
from dpm_store.products.records import MetricBound

Layers = Mapping[str, NDArray[Any]]
#: Number of products from which the level of an enlarged tile is determined.
_SAMPLE = 100


@dataclass(frozen=True, slots=True)
class MapState:
    """Maps that a tile shows; every field that is set restricts them.

    Attributes
    ----------
    robot : str or None
    t0_ns, t1_ns : int or None
        The capture ended at or after the first, and at or before the second time.
    as_of_ns : int or None
        Mission time of the state of products and frames.
    metrics : tuple of MetricBound
        Bounds of metrics of the quality.
    """

    robot: str | None = None
    t0_ns: int | None = None
    t1_ns: int | None = None
    as_of_ns: int | None = None
    metrics: tuple[MetricBound, ...] = ()

    def restrict(self, query: Query) -> Query:
        """Return a query of the maps of this state."""
        return replace(
            query,
            robot=self.robot,
            t0_ns=self.t0_ns,
            t1_ns=self.t1_ns,
            as_of_ns=self.as_of_ns,
            metrics=self.metrics,
        )


#: All maps, as they are now.
NEWEST = MapState()


@dataclass(frozen=True, slots=True)
class TileAnalysis:
    """Parameters of the analyses of heights; those of other layers are None.

    Attributes
    ----------
    interval_m : float or None
        Of contours.
    since_ns : int or None
        Of the difference: captures that ended until then are compared with later ones.
    observer_m, observer_height_m, target_height_m, range_m
        Of the viewshed, see ``cdff_common.raster.viewshed``.
    """

    interval_m: float | None = None
    since_ns: int | None = None
    observer_m: tuple[float, float] | None = None
    observer_height_m: float | None = None
    target_height_m: float | None = None
    range_m: float | None = None

    def check(self, layer: str) -> None:
        """Raise InputError if a parameter is missing, or belongs to another layer."""
        of_layer = _ANALYSIS_PARAMETERS.get(layer, ())
        for parameter in fields(self):
            name = parameter.name.removesuffix("_ns").replace("observer_m", "observer")
            is_given = getattr(self, parameter.name) is not None
            if is_given and parameter.name not in of_layer:
                raise InputError(f"{name}: layer {layer} has no such parameter")
            if not is_given and parameter.name in of_layer[:1]:
                raise InputError(f"layer {layer} without {name}: give it")


_ANALYSIS_PARAMETERS = {
    "contours": ("interval_m",),
    "difference": ("since_ns",),
    "viewshed": ("observer_m", "observer_height_m", "target_height_m", "range_m"),
}
#: Default of the heights of the observer, and of the longest line of sight, metres.
EYE_M, RANGE_M = 2.0, 50.0
#: Largest number of cells of a viewshed, beyond which its cells are larger; number of viewsheds in memory.
_MOST_VIEWSHED_CELLS, _VIEWSHEDS = 1 << 17, 4
#: No parameters of an analysis.
NO_ANALYSIS = TileAnalysis()


class ViewshedCache:
    """The last viewsheds, which the tiles of a view share, until a map changes."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._values: OrderedDict[Hashable, NDArray[np.float64]] = OrderedDict()
        self._changes = 0

    def get(self, key: Hashable, compute: Callable[[], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return a viewshed, computed if it is not there; the lock is not held meanwhile."""
        with self._lock:
            if key in self._values:
                self._values.move_to_end(key)
                return self._values[key]
            changes = self._changes
        value = compute()
        with self._lock:
            if self._changes == changes:
                self._values[key] = value
                while len(self._values) > _VIEWSHEDS:
                    self._values.popitem(last=False)
        return value

    def clear(self) -> None:
        """Remove all viewsheds."""
        with self._lock:
            self._changes += 1
            self._values.clear()


class TileCells:
    """Reads cells of elevation and navigation maps.

    Parameters
    ----------
    store : Store
    product : str
        ``dem`` or ``navigation_map``.
    state : MapState
    viewsheds : ViewshedCache
    """

    def __init__(self, store: Store, product: str, state: MapState, viewsheds: ViewshedCache) -> None:
        self._viewsheds = viewsheds
        self._store = store
        self._product = product
        self._state = state

    def read(self, z: int, geometry: GridGeometry) -> Layers:
        """Return the layers of a rectangle of cells of a level; from pooled tiles for the newest state."""
        pyramid, maps, frame = self._store.pyramid, self._store.maps, geometry.frame
        if self._state != NEWEST:
            query = self._state.restrict(tile_query(frame, geometry))
            source = maps if self._product == "dem" else maps.navigation
            return pyramid.without_changes(frame, lambda: source.cells_in_state(query, geometry))
        if self._product == "dem":
            return pyramid.statistics(frame, z, geometry).to_layers(0)
        return pyramid.without_changes(frame, lambda: maps.navigation.rectangle(frame, z, geometry))

    def analysed(self, layer: str, analysis: TileAnalysis, z: int, geometry: GridGeometry) -> Layers:
        """Return the result of an analysis in a rectangle of cells of a level, as their ``mean``."""
        if layer == "difference":
            heights = []
            assert analysis.since_ns is not None
            since_ns = analysis.since_ns
            for state in (replace(self._state, t1_ns=since_ns), replace(self._state, t0_ns=since_ns + 1)):
                part = TileCells(self._store, self._product, state, self._viewsheds)
                heights.append(part.read(z, geometry))
            earlier, later = heights
            return {
                "mean": later["mean"] - earlier["mean"],
                "variance": later["variance"] + earlier["variance"],
            }
        if layer == "contours":
            cells = self.read(z, geometry)
            assert analysis.interval_m is not None
            return {**cells, "mean": contour_cells(cells["mean"], analysis.interval_m)}
        return self._visible(analysis, z, geometry)

    def _visible(self, analysis: TileAnalysis, z: int, geometry: GridGeometry) -> Layers:
        """Return the probability of visibility; of cells of a coarser level if the range has many."""
        assert analysis.observer_m is not None
        x, y = analysis.observer_m
        reach = RANGE_M if analysis.range_m is None else analysis.range_m
        unknown = np.full(geometry.shape, np.nan, dtype=np.float32)
        bounds, margin_m = geometry.bounds, reach + cell_m(z)
        is_near_x = bounds.xmin - margin_m < x < bounds.xmax + margin_m
        is_near_y = bounds.ymin - margin_m < y < bounds.ymax + margin_m
        if not (is_near_x and is_near_y):
            return {"mean": unknown, "variance": unknown}
        level = self._level_at(x, y, z, geometry.frame)
        while level > 0 and (2.0 * reach / cell_m(level) + 1.0) ** 2 > _MOST_VIEWSHED_CELLS:
            level -= 1
        around = GridGeometry.aligned(
            geometry.frame, cell_m(level), (x - reach, y - reach, x + reach, y + reach)
        )

        def computed() -> NDArray[np.float64]:
            eye = EYE_M if analysis.observer_height_m is None else analysis.observer_height_m
            return viewshed(
                around,
                self.read(level, around)["mean"],
                np.full(around.shape, np.nan),
                (x, y),
                observer_height_m=eye,
                target_height_m=analysis.target_height_m or 0.0,
                range_m=reach,
            ).visible

        values = self._viewsheds.get((around, analysis, self._state), computed)
        rows, cols, inside = around.cells_of(*geometry.centres_m())
        visible = np.where(inside, values[rows, cols], np.nan).astype(np.float32)
        return {"mean": visible, "variance": unknown}

    def _level_at(self, x: float, y: float, z: int, frame: str) -> int:
        """Return the finest level, z or coarser, with an observed cell at a point; z without any."""
        level: int | None = z
        while level is not None:
            edge_m = EDGE_CELLS * cell_m(level)
            cells = GridGeometry.aligned(
                frame, cell_m(level), (x - edge_m, y - edge_m, x + edge_m, y + edge_m)
            )
            if np.isfinite(self.read(level, cells)["mean"]).any():
                return level
            level = self.coarser_level(level, cells)
        return z

    def coarser_level(self, z: int, geometry: GridGeometry) -> int | None:
        """Return the level of the finest cells in a rectangle that are larger than those of a level; None
        without any.
        """
        query = tile_query(geometry.frame, geometry)
        query = replace(
            query, resolution_max_m=None, resolution_above_m=cell_m(min(z, LAST_LEVEL)) * (1 + 1e-6)
        )
        page = self._store.search(replace(self._state.restrict(query), types=(self._product,), limit=_SAMPLE))
        sizes = [r.fields["resolution_m"] for r in page.items if r.fields.get("resolution_m") is not None]
        return min(level_of(min(sizes)), z - 1) if sizes and z > 0 else None

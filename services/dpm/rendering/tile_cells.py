# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cells of maps for tiles: of a state of the maps, and of a coarser level where finer cells do not exist."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from numpy.typing import NDArray

from cdff_common.raster.geometry import GridGeometry
from cdff_common.raster.tiles import LAST_LEVEL, cell_m, level_of
from dpm_store import Query, Store
from dpm_store.maps.tile_queries import tile_query
from dpm_store.products.records import MetricBound

Layers = Mapping[str, NDArray[Any]]
#: Products that determine the level of an enlarged tile.
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


class TileCells:
    """Reads cells of elevation and navigation maps.

    Parameters
    ----------
    store : Store
    product : str
        ``dem`` or ``navigation_map``.
    state : MapState
    """

    def __init__(self, store: Store, product: str, state: MapState) -> None:
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

    def coarser_level(self, z: int, geometry: GridGeometry) -> int | None:
        """Return the level of the finest cells in a rectangle that are larger than those of a level; None
        without any.
        """
        query = tile_query(geometry.frame, geometry)
        query = replace(
            query, resolution_max_m=None, resolution_above_m=cell_m(min(z, LAST_LEVEL)) * (1 + 1e-6)
        )
        found = self._store.search(
            replace(self._state.restrict(query), types=(self._product,), limit=_SAMPLE)
        )
        sizes = [r.fields["resolution_m"] for r in found.items if r.fields.get("resolution_m") is not None]
        return min(level_of(min(sizes)), z - 1) if sizes and z > 0 else None

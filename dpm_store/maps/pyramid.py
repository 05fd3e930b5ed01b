# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Overviews: pooled statistics of the tiles of a frame, computed on request and discarded after changes.

A rectangle with few patches is assembled from them. With more patches it is cut from whole tiles, and a tile
is pooled exactly from its four children and from the patches whose cells are too coarse for them. Tiles are
cached in memory and in files. An insertion or deletion discards the tiles that the patch's box touches, at
every level; a frame revision discards the tiles at the previous and new location of the moved patches.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, func, select

from cdff_common.errors import UnavailableError
from cdff_common.geometry.region import Region
from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.frames.frames import FrameTable, HistoryView
from dpm_store.history.events import Event, EventTable
from dpm_store.maps.patches import DERIVED_DFPC, Bounds, Patches, PatchSelection, bounds_in
from dpm_store.maps.tile_files import TileFiles
from dpm_store.maps.windows import add_patches
from dpm_store.products.records import Query

if TYPE_CHECKING:
    from cdff_common.raster import CellStatistics, GridGeometry
    from cdff_common.raster.tiles import Tile

#: A rectangle with more patches is cut from tiles.
FEW = 24
#: Tiles in memory, 3.3 MB each, and bytes in files.
_CACHED = 12
_FILE_BYTES = 512 << 20
#: Kinds of products in tiles.
MAPS = ("dem", "navigation_map")
_KINDS = ("inserted", "deleted", "reanchored")
_EVENTS = 1000
#: Margin that excludes patches which end at the edge of a rectangle.
_INSET_M = 1e-4
_ATTEMPTS = 3

Read = TypeVar("Read")
Key = tuple[str, int, int, int]


@dataclass(frozen=True, slots=True)
class Change:
    """A rectangle of a frame, metres, in which maps of a product type, or of any for None, have changed."""

    frame: str
    bounds: Bounds
    product: str | None = None


class Pyramid:
    """Statistics of tiles.

    Parameters
    ----------
    directory : Path
        Folder of the tile files, which can be deleted while the store is closed.
    """

    def __init__(
        self, database: Database, patches: Patches, frames: FrameTable, events: EventTable, directory: Path
    ) -> None:
        self._database = database
        self._patches = patches
        self._frames = frames
        self._events = events
        self._lock = threading.RLock()
        self._cache: OrderedDict[Key, CellStatistics] = OrderedDict()
        self._files = TileFiles(directory, _FILE_BYTES)
        self._last_event = self._files.open(events.last_ordinal())
        self._frames_in_use: set[str] = self._files.frames()
        self._listeners: list[Callable[[Change], None]] = []

    def listen(self, listener: Callable[[Change], None]) -> None:
        """Register a listener for every change that ``sync`` finds."""
        self._listeners.append(listener)

    def sync(self) -> int:
        """Drop tiles that changed since the last call; return the ordinal of the last event."""
        if self._events.last_ordinal() == self._last_event:
            return self._last_event
        with self._lock:
            last, page = self._events.last_ordinal(), _EVENTS
            while page == _EVENTS:
                events = self._events.since(self._last_event, kind=_KINDS, limit=_EVENTS)
                for change in (change for event in events for change in self._changes(event)):
                    if change.product in (None, "dem"):
                        self._drop(change)
                    for listener in self._listeners:
                        listener(change)
                page = len(events)
                self._last_event = events[-1].ordinal if events else self._last_event
            self._last_event = max(self._last_event, last)
            return self._last_event

    def statistics(self, frame: str, z: int, geometry: GridGeometry) -> CellStatistics:
        """Return pooled statistics of a rectangle of cells of level ``z``.

        Parameters
        ----------
        geometry : GridGeometry
            Cells of the level's size.

        Raises
        ------
        UnavailableError
            If products are inserted faster than the rectangle can be read.
        """
        return self.without_changes(frame, lambda: self._rectangle(frame, z, geometry))

    def without_changes(self, frame: str, make: Callable[[], Read]) -> Read:
        """Return the result of ``make``, repeated if products change during the call; raises like
        ``statistics``.
        """
        with self._lock:
            self._frames_in_use.add(frame)
            for _ in range(_ATTEMPTS):
                before = self.sync()
                result = make()
                if self.sync() == before:
                    return result
            raise UnavailableError(
                f"tiles of {frame}: products are inserted faster than they can be pooled; try again"
            )

    def close(self) -> None:
        """Prepare the files for the next start."""
        self._files.close(self._last_event)

    def _rectangle(self, frame: str, z: int, geometry: GridGeometry) -> CellStatistics:
        from cdff_common.raster import CellStatistics
        from cdff_common.raster.tiles import Tile, tiles_over

        few = self._find_few_patches(frame, geometry)
        if few is not None:
            return self._pool_patches(few, geometry)
        result = CellStatistics.empty(geometry)
        inset = geometry.resolution_m / 2.0
        b = geometry.bounds
        columns, rows = tiles_over(z, (b.xmin + inset, b.ymin + inset, b.xmax - inset, b.ymax - inset))
        for y in rows:
            for x in columns:
                part = self._tile(frame, Tile(z, x, y))
                if part is not None:
                    result.add(part)
        return result

    def _tile(self, frame: str, tile: Tile) -> CellStatistics | None:
        """Return the statistics of a whole tile; None for an empty one."""
        key = (frame, tile.z, tile.x, tile.y)
        statistics = self._cache.get(key)
        if statistics is None:
            geometry = tile.geometry(frame)
            statistics = self._files.read(key, geometry)
            if statistics is None:
                few = self._find_few_patches(frame, geometry)
                if few is not None:  # pooling few patches is as fast as reading a file
                    return self._pool_patches(few, geometry) if few.records else None
                statistics = self._pool_tile(frame, tile, geometry)
                self._files.write(key, statistics)
            self._cache[key] = statistics
        self._cache.move_to_end(key)
        while len(self._cache) > _CACHED:
            self._cache.popitem(last=False)
        return statistics

    def _pool_tile(self, frame: str, tile: Tile, geometry: GridGeometry) -> CellStatistics:
        """Return the statistics of a tile with many patches, from finer tiles and coarse patches."""
        from cdff_common.raster import aggregate

        selection, children = tile_parts(self._patches, frame, tile)
        result = self._pool_patches(selection, geometry)
        for child in children:
            part = self._tile(frame, child)
            if part is not None:
                result.add(aggregate(part, 2))
        return result

    def _find_few_patches(self, frame: str, geometry: GridGeometry) -> PatchSelection | None:
        """Return the patches in a rectangle if they are at most ``FEW``, else None."""
        return self._patches.find_few(tile_query(frame, geometry), FEW)

    def _pool_patches(self, selection: PatchSelection, geometry: GridGeometry) -> CellStatistics:
        """Return the statistics of the selected patches in the cells of a grid."""
        from cdff_common.raster.mosaic import Mosaic

        mosaic = Mosaic(geometry)
        add_patches(
            self._patches,
            selection,
            geometry,
            lambda patch, T: mosaic.add(patch.geometry, patch.layers, patch.t1_ns, T),
        )
        return mosaic.assembled().statistics

    def _drop(self, change: Change) -> None:
        for key in tiles_of_change((*self._cache, *self._files.keys()), change):
            self._cache.pop(key, None)
            self._files.remove(key)

    def _changes(self, event: Event) -> Iterable[Change]:
        body = event.body
        if event.kind == "reanchored":
            yield from self._changes_of_revision(int(body["frames_revision"]))
        elif body.get("product") in MAPS and body.get("dfpc") != DERIVED_DFPC and "box_m" in body:
            yield from self._changes_of_map(
                body["product"], str(body["frame"]), np.array(body["box_m"], dtype=np.float64)
            )

    def _changes_of_revision(self, state: int) -> Iterable[Change]:
        """Return the previous and the new rectangle of the patches that a frame revision moves."""
        with self._database.read() as connection:
            before = self._frames.tree(HistoryView(state=state - 1), connection=connection)
            after = self._frames.tree(HistoryView(state=state), connection=connection)
            map_frames = connection.execute(select(schema.frame_names.c.frame)).scalars().all()
            for map_frame in map_frames:
                box = None
                for frame in sorted(self._frames_in_use):
                    old, new = before.find(frame, map_frame), after.find(frame, map_frame)
                    if old is not None and new is not None and np.array_equal(old.matrix, new.matrix):
                        continue
                    box = _patches_box(connection, map_frame) if box is None else box
                    for T in (old, new):
                        if T is not None and np.isfinite(box).all():
                            yield Change(frame, bounds_in(T, box))

    def _changes_of_map(self, product: str, map_frame: str, box: NDArray[np.float64]) -> Iterable[Change]:
        tree = self._frames.tree()
        for frame in sorted(self._frames_in_use):
            T = tree.find(frame, map_frame)
            if T is not None:
                yield Change(frame, bounds_in(T, box), product)


def tiles_of_change(keys: Iterable[Key], change: Change, margin_cells: int = 0) -> list[Key]:
    """Return the tiles that a change touches within ``margin_cells``."""
    from cdff_common.raster.tiles import cell_m, tiles_over

    levels: dict[int, tuple[range, range]] = {}
    touched = []
    for key in keys:
        frame, z, x, y = key
        if frame != change.frame:
            continue
        if z not in levels:
            b, margin = change.bounds, margin_cells * cell_m(z)
            levels[z] = tiles_over(z, (b[0] - margin, b[1] - margin, b[2] + margin, b[3] + margin))
        columns, rows = levels[z]
        if x in columns and y in rows:
            touched.append(key)
    return touched


def _patches_box(connection: Connection, frame: str) -> NDArray[np.float64]:
    """Return the box of all maps of a frame; NaN if there is none."""
    p = schema.products.c
    low = func.min(p.xmin_m), func.min(p.ymin_m), func.min(p.zmin_m)
    high = func.max(p.xmax_m), func.max(p.ymax_m), func.max(p.zmax_m)
    conditions = p.frame == frame, p.product.in_(MAPS), p.dfpc != DERIVED_DFPC, p.deleted_ns.is_(None)
    row = connection.execute(select(*low, *high).where(*conditions)).one()
    return np.array([np.nan if v is None else v for v in row], dtype=np.float64)


def tile_parts(patches: Patches, frame: str, tile: Tile) -> tuple[PatchSelection, Iterable[Tile]]:
    """Return the patches to pool in a tile with many, and the tiles of the next level to add to them."""
    from cdff_common.raster.tiles import LAST_LEVEL, cell_m

    geometry = tile.geometry(frame)
    if tile.z == LAST_LEVEL:
        return patches.find(tile_query(frame, geometry)), ()
    finer_m = cell_m(tile.z + 1) * (1.0 + 1e-6)
    coarse = patches.find(tile_query(frame, geometry, above_cell_m=finer_m))
    has_finer = patches.any(tile_query(frame, geometry, max_cell_m=finer_m))
    return coarse, tile.children() if has_finer else ()


def tile_query(
    frame: str, geometry: GridGeometry, *, above_cell_m: float | None = None, max_cell_m: float | None = None
) -> Query:
    """Return the query of patches in a rectangle with cells that are not larger than its own."""
    b = geometry.bounds
    region = Region("bbox", (b.xmin + _INSET_M, b.ymin + _INSET_M, b.xmax - _INSET_M, b.ymax - _INSET_M))
    limit_m = geometry.resolution_m * (1.0 + 1e-6) if max_cell_m is None else max_cell_m
    return Query(frame=frame, region=region, resolution_max_m=limit_m, resolution_above_m=above_cell_m)

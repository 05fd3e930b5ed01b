# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Overviews: pooled statistics of the tiles of a frame, computed on request and discarded after changes.

A rectangle with few patches is assembled from them. With more patches it is cut from whole tiles, and a tile
is pooled exactly from its four children and from the patches whose cells are too coarse for them. Tiles are
cached in memory and in files. Inserted patches are added to the tiles that they touch when these are read
again. A deletion discards the tiles that the patch's box touches, at every level; a frame revision discards
the tiles at the previous and new location of the moved patches.
"""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from sqlalchemy import func, select

from cdff_common.errors import OverloadedError, UnavailableError
from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.frames.frames import FrameTable
from dpm_store.history.events import EventTable
from dpm_store.maps.patches import Patches, PatchSelection
from dpm_store.maps.tile_changes import KINDS, Change, MapChanges, tiles_of_change
from dpm_store.maps.tile_files import Key, TileFiles
from dpm_store.maps.tile_queries import FEW, tile_parts, tile_query
from dpm_store.maps.windows import add_patches

if TYPE_CHECKING:
    from cdff_common.raster import CellStatistics, GridGeometry
    from cdff_common.raster.tiles import Tile

#: Tiles in memory, 3.3 MB each, and bytes in files.
_CACHED = 12
_FILE_BYTES = 512 << 20
#: Events that are read at once, and attempts to compute a tile while patches change.
_EVENTS = 1000
_ATTEMPTS = 3
#: Longest wait of a request for others that pool tiles, seconds.
_WAIT_S = 8.0

Read = TypeVar("Read")


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
        self._events = events
        self._lock = threading.RLock()
        self._cache: OrderedDict[Key, CellStatistics] = OrderedDict()
        self._files = TileFiles(directory, _FILE_BYTES)
        self._last_event, self._included = self._files.open(events.last_ordinal())
        self._known_product = self._last_product()
        self._extended: set[Key] = set()
        self._last_change = self._last_removal = 0
        self._changes = MapChanges(database, frames, self._files.frames())
        self._listeners: list[Callable[[Change], None]] = []

    def listen(self, listener: Callable[[Change], None]) -> None:
        """Register a listener for every change that ``sync`` finds."""
        self._listeners.append(listener)

    def sync(self) -> int:
        """Find the tiles that changed since the last call; return the ordinal of the last change of a map.

        Raises
        ------
        OverloadedError
            If other requests pool tiles for too long.
        """
        if self._events.last_ordinal() == self._last_event:
            return self._last_change
        with self._locked():
            last, page = self._events.last_ordinal(), _EVENTS
            event_ordinal = self._last_event
            while page == _EVENTS:
                events = self._events.since(event_ordinal, kind=KINDS, limit=_EVENTS)
                for event in events:
                    for change in self._changes.of(event):
                        self._apply(change, event.ordinal)
                page = len(events)
                event_ordinal = events[-1].ordinal if events else event_ordinal
            # The products are counted after the events, so that none of them is missing in tiles made now.
            self._last_event = max(event_ordinal, last)
            self._known_product = self._last_product()
            return self._last_change

    def statistics(self, frame: str, z: int, geometry: GridGeometry) -> CellStatistics:
        """Return pooled statistics of a rectangle of cells of level ``z``.

        Parameters
        ----------
        geometry : GridGeometry
            Cells of the level's size.

        Raises
        ------
        OverloadedError
            If other requests pool tiles for too long.
        UnavailableError
            If maps are deleted or moved faster than the rectangle can be read.
        """
        return self._unless_changed(
            frame, lambda: self._rectangle(frame, z, geometry), lambda: self._last_removal
        )

    def without_changes(self, frame: str, make: Callable[[], Read]) -> Read:
        """Return the result of ``make``, repeated if maps change during the call; raises like
        ``statistics``.
        """
        return self._unless_changed(frame, make, lambda: self._last_change)

    def close(self) -> None:
        """Prepare the files for the next start."""
        for key in self._extended:
            self._files.remove(key)
        self._files.close(self._last_event, self._included)

    def _unless_changed(self, frame: str, make: Callable[[], Read], state: Callable[[], int]) -> Read:
        """Return the result of ``make``, repeated until ``state`` is the same before and after it."""
        with self._locked():
            self._changes.frames_in_use.add(frame)
            for _ in range(_ATTEMPTS):
                self.sync()
                before = state()
                result = make()
                self.sync()
                if state() == before:
                    return result
            raise UnavailableError(f"tiles of {frame}: maps change faster than they can be pooled; try again")

    @contextmanager
    def _locked(self) -> Iterator[None]:
        if not self._lock.acquire(timeout=_WAIT_S):
            raise OverloadedError(f"other requests have pooled tiles for {_WAIT_S:g} s; try again", _WAIT_S)
        try:
            yield
        finally:
            self._lock.release()

    def _last_product(self) -> int:
        with self._database.read() as connection:
            return connection.execute(select(func.max(schema.products.c.ordinal))).scalar() or 0

    def _apply(self, change: Change, ordinal: int) -> None:
        """Mark or discard the tiles of a change, and report it."""
        self._last_change = ordinal
        if not change.is_insertion:
            self._last_removal = ordinal
        if change.product in (None, "dem"):
            for key in tiles_of_change((*self._cache, *self._files.keys()), change):
                if change.is_insertion:
                    self._extended.add(key)
                else:
                    self._cache.pop(key, None)
                    self._files.remove(key)
        for listener in self._listeners:
            listener(change)

    def _rectangle(self, frame: str, z: int, geometry: GridGeometry) -> CellStatistics:
        """Return the statistics of the cells of a rectangle: from few patches directly, otherwise from
        tiles.
        """
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
                self._store(key, statistics)
        if key in self._extended:
            statistics = self._add_inserted(key, tile.geometry(frame), statistics)
            self._store(key, statistics)
        self._cache[key] = statistics
        self._cache.move_to_end(key)
        while len(self._cache) > _CACHED:
            self._cache.popitem(last=False)
        return statistics

    def _store(self, key: Key, statistics: CellStatistics) -> None:
        self._files.write(key, statistics)
        self._included[key] = self._known_product
        self._extended.discard(key)

    def _add_inserted(self, key: Key, geometry: GridGeometry, statistics: CellStatistics) -> CellStatistics:
        """Return the statistics of a tile with the patches that were inserted after it was made."""
        from cdff_common.raster import CellStatistics

        query = replace(tile_query(key[0], geometry), inserted_after=self._included[key])
        result = CellStatistics.empty(geometry)
        result.add(statistics)
        result.add(self._pool_patches(self._known(self._patches.find(query)), geometry))
        return result

    def _pool_tile(self, frame: str, tile: Tile, geometry: GridGeometry) -> CellStatistics:
        """Return the statistics of a tile with many patches, from finer tiles and coarse patches."""
        from cdff_common.raster import aggregate

        selection, children = tile_parts(self._patches, frame, tile)
        result = self._pool_patches(self._known(selection), geometry)
        for child in children:
            part = self._tile(frame, child)
            if part is not None:
                result.add(aggregate(part, 2))
        return result

    def _find_few_patches(self, frame: str, geometry: GridGeometry) -> PatchSelection | None:
        """Return the patches in a rectangle if they are at most ``FEW``, else None."""
        few = self._patches.find_few(tile_query(frame, geometry), FEW)
        return None if few is None else self._known(few)

    def _known(self, selection: PatchSelection) -> PatchSelection:
        """Return the selection without patches that were inserted after the last ``sync``."""
        records = tuple(r for r in selection.records if r.ordinal <= self._known_product)
        return replace(selection, records=records)

    def _pool_patches(self, selection: PatchSelection, geometry: GridGeometry) -> CellStatistics:
        """Return the statistics of the selected patches in the cells of a grid."""
        from cdff_common.raster.mosaic import Mosaic

        mosaic = Mosaic(geometry)
        add_patches(
            self._patches,
            selection,
            geometry,
            lambda patch, T: mosaic.add(patch.geometry, patch.layers, patch.t1_ns, T) is not None,
        )
        return mosaic.assembled().statistics

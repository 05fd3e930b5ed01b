# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Overviews: pooled statistics of the tiles of a frame, built when asked for, dropped when what is in them changes.

A rectangle that few patches reach into is assembled from them. Where there are more, it is cut from whole tiles, and a
tile is pooled from its four children, exactly, and from the patches whose cells are too coarse for them. Tiles are
kept, in memory and as files. An insertion or deletion drops those that the patch's box touches, at every level; the
revision of a frame drops those where the patches were that it moves, and where they are.
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
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from dpm_store import schema
from dpm_store.database import Database
from dpm_store.events import Event, EventTable
from dpm_store.frames import FrameTable, Known
from dpm_store.patches import DERIVED_DFPC, Found, Patches
from dpm_store.records import Query
from dpm_store.tile_files import TileFiles

if TYPE_CHECKING:
    from cdff_common.raster import CellStatistics, GridGeometry
    from cdff_common.raster.tiles import Tile

#: A rectangle that more patches reach into is cut from tiles.
FEW = 24
#: Tiles kept in memory, 3.3 MB each, and bytes kept as files.
_KEPT = 12
_FILE_BYTES = 512 << 20
#: Products that tiles are drawn of.
MAPS = ("dem", "navigation_map")
_KINDS = ("inserted", "deleted", "reanchored")
_EVENTS = 1000
#: A patch that ends at the edge of a rectangle does not reach into it.
_INSET_M = 1e-4
_ATTEMPTS = 3

Read = TypeVar("Read")
Key = tuple[str, int, int, int]
Bounds = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class Change:
    """A rectangle of a frame in which an event changed what there is of a product, metres; of any with no product."""

    frame: str
    bounds: Bounds
    product: str | None = None


class Pyramid:
    """Statistics of tiles.

    Parameters
    ----------
    directory : Path
        For files of tiles; what is in it can be deleted while the store is closed.
    """

    def __init__(
        self, database: Database, patches: Patches, frames: FrameTable, events: EventTable, directory: Path
    ) -> None:
        self._database = database
        self._patches = patches
        self._frames = frames
        self._events = events
        self._lock = threading.RLock()
        self._kept: OrderedDict[Key, CellStatistics] = OrderedDict()
        self._files = TileFiles(directory, _FILE_BYTES)
        self._seen = self._files.open(events.last_ordinal())
        self._asked_frames: set[str] = self._files.frames()
        self._listeners: list[Callable[[Change], None]] = []

    def listen(self, listener: Callable[[Change], None]) -> None:
        """Call ``listener`` with every change that ``sync`` finds."""
        self._listeners.append(listener)

    def sync(self) -> int:
        """Drop what has changed since the last call; returns the ordinal of the last event that counts."""
        if self._events.last_ordinal() == self._seen:
            return self._seen
        with self._lock:
            last, page = self._events.last_ordinal(), _EVENTS
            while page == _EVENTS:
                events = self._events.since(self._seen, kind=_KINDS, limit=_EVENTS)
                for change in (change for event in events for change in self._changes(event)):
                    if change.product in (None, "dem"):
                        self._drop(change)
                    for listener in self._listeners:
                        listener(change)
                page = len(events)
                self._seen = events[-1].ordinal if events else self._seen
            self._seen = max(self._seen, last)
            return self._seen

    def statistics(self, frame: str, z: int, geometry: GridGeometry) -> CellStatistics:
        """Pooled statistics of a rectangle of cells of level ``z``.

        Parameters
        ----------
        geometry : GridGeometry
            Of the level's cell size.

        Raises
        ------
        UnavailableError
            If products come faster than the rectangle can be read.
        """
        return self.settled(frame, lambda: self._rectangle(frame, z, geometry))

    def settled(self, frame: str, make: Callable[[], Read]) -> Read:
        """What ``make`` reads of a frame, once nothing changed meanwhile; raises as ``statistics``."""
        with self._lock:
            self._asked_frames.add(frame)
            for _ in range(_ATTEMPTS):
                before = self.sync()
                made = make()
                if self.sync() == before:
                    return made
            raise UnavailableError(f"tiles of {frame}: products come faster than they can be pooled; ask again")

    def close(self) -> None:
        """Leave the files to be found by the next start."""
        self._files.close(self._seen)

    def _rectangle(self, frame: str, z: int, geometry: GridGeometry) -> CellStatistics:
        from cdff_common.raster import CellStatistics
        from cdff_common.raster.tiles import Tile, tiles_over

        found = self._few(frame, geometry)
        if found is not None:
            return self._pooled(found, geometry)
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
        """Statistics of a whole tile, None where there is nothing in it."""
        key = (frame, tile.z, tile.x, tile.y)
        known = self._kept.get(key)
        if known is None:
            geometry = tile.geometry(frame)
            known = self._files.read(key, geometry)
            if known is None:
                found = self._few(frame, geometry)
                if found is not None:  # made again as fast as it would be read
                    return self._pooled(found, geometry) if found.records else None
                known = self._built(frame, tile, geometry)
                self._files.write(key, known)
            self._kept[key] = known
        self._kept.move_to_end(key)
        while len(self._kept) > _KEPT:
            self._kept.popitem(last=False)
        return known

    def _built(self, frame: str, tile: Tile, geometry: GridGeometry) -> CellStatistics:
        """Pool a tile that many patches reach into."""
        from cdff_common.raster import aggregate
        from cdff_common.raster.tiles import LAST_LEVEL, cell_m

        if tile.z == LAST_LEVEL:
            return self._pooled(self._patches.find(tile_query(frame, geometry)), geometry)
        finer_m = cell_m(tile.z + 1) * (1.0 + 1e-6)
        result = self._pooled(self._patches.find(tile_query(frame, geometry, above_m=finer_m)), geometry)
        if self._patches.any(tile_query(frame, geometry, most_m=finer_m)):
            for child in tile.children():
                part = self._tile(frame, child)
                if part is not None:
                    result.add(aggregate(part, 2))
        return result

    def _few(self, frame: str, geometry: GridGeometry) -> Found | None:
        return self._patches.find_few(tile_query(frame, geometry), FEW)

    def _pooled(self, found: Found, geometry: GridGeometry) -> CellStatistics:
        from cdff_common.raster.mosaic import Mosaic, is_level

        mosaic = Mosaic(geometry)
        usable = [r for r in found.records if (T := found.transforms.get(r.header.frame)) is None or is_level(T)]
        for record, patch in self._patches.read(usable):
            if patch is not None:
                mosaic.add(patch.geometry, patch.layers, patch.t1_ns, found.transforms.get(record.header.frame))
        return mosaic.assembled().statistics

    def _drop(self, change: Change) -> None:
        for key in touched((*self._kept, *self._files.keys()), change):
            self._kept.pop(key, None)
            self._files.remove(key)

    def _changes(self, event: Event) -> Iterable[Change]:
        body = event.body
        if event.kind == "reanchored":
            yield from self._moved(int(body["frames_revision"]))
        elif body.get("product") in MAPS and body.get("dfpc") != DERIVED_DFPC and "box_m" in body:
            yield from self._touched(body["product"], str(body["frame"]), np.array(body["box_m"], dtype=np.float64))

    def _moved(self, state: int) -> Iterable[Change]:
        """Where the patches were that a frame's revision moves, and where they are, as one rectangle a frame each."""
        with self._database.read() as connection:
            before = self._frames.tree_in(connection, Known(state=state - 1))
            after = self._frames.tree_in(connection, Known(state=state))
            homes = connection.execute(select(schema.frame_names.c.frame)).scalars().all()
            for home in homes:
                box = None
                for frame in sorted(self._asked_frames):
                    old, new = before.find(frame, home), after.find(frame, home)
                    if old is not None and new is not None and np.array_equal(old.matrix, new.matrix):
                        continue
                    box = _patches_box(connection, home) if box is None else box
                    for T in (old, new):
                        if T is not None and np.isfinite(box).all():
                            yield Change(frame, bounds_in(T, box))

    def _touched(self, product: str, home: str, box: NDArray[np.float64]) -> Iterable[Change]:
        with self._database.read() as connection:
            tree = self._frames.tree_in(connection)
        for frame in sorted(self._asked_frames):
            T = tree.find(frame, home)
            if T is not None:
                yield Change(frame, bounds_in(T, box), product)


def touched(keys: Iterable[Key], change: Change, margin_cells: int = 0) -> list[Key]:
    """Those of the tiles that a change reaches into, or comes as near as ``margin_cells``."""
    from cdff_common.raster.tiles import cell_m, tiles_over

    levels: dict[int, tuple[range, range]] = {}
    found = []
    for key in keys:
        frame, z, x, y = key
        if frame != change.frame:
            continue
        if z not in levels:
            b, wider = change.bounds, margin_cells * cell_m(z)
            levels[z] = tiles_over(z, (b[0] - wider, b[1] - wider, b[2] + wider, b[3] + wider))
        columns, rows = levels[z]
        if x in columns and y in rows:
            found.append(key)
    return found


def bounds_in(T: UncertainTransform, box: NDArray[np.float64]) -> Bounds:
    """Bounds of a box ``(6,)`` carried into another frame, metres."""
    corners = np.array([[box[i], box[j], box[k]] for i in (0, 3) for j in (1, 4) for k in (2, 5)])
    moved = T.apply(corners)[:, :2]
    (xmin, ymin), (xmax, ymax) = moved.min(axis=0), moved.max(axis=0)
    return float(xmin), float(ymin), float(xmax), float(ymax)


def _patches_box(connection: Connection, frame: str) -> NDArray[np.float64]:
    """Box around all maps of a frame, not finite without any."""
    p = schema.products.c
    low = func.min(p.xmin_m), func.min(p.ymin_m), func.min(p.zmin_m)
    high = func.max(p.xmax_m), func.max(p.ymax_m), func.max(p.zmax_m)
    here = p.frame == frame, p.product.in_(MAPS), p.dfpc != DERIVED_DFPC, p.deleted_ns.is_(None)
    row = connection.execute(select(*low, *high).where(*here)).one()
    return np.array([np.nan if v is None else v for v in row], dtype=np.float64)


def tile_query(
    frame: str, geometry: GridGeometry, *, above_m: float | None = None, most_m: float | None = None
) -> Query:
    """Patches that may reach into a rectangle and whose cells are no larger than its own."""
    b = geometry.bounds
    region = Region("bbox", (b.xmin + _INSET_M, b.ymin + _INSET_M, b.xmax - _INSET_M, b.ymax - _INSET_M))
    limit_m = geometry.resolution_m * (1.0 + 1e-6) if most_m is None else most_m
    return Query(frame=frame, region=region, resolution_max_m=limit_m, resolution_above_m=above_m)

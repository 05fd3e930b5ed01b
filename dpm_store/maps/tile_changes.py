# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rectangles in which insertions, deletions and frame revisions change maps, and the tiles they touch."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, func, select

from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.frames.frames import FrameTable, HistoryView
from dpm_store.history.events import Event
from dpm_store.maps.patches import DERIVED_DFPC, Bounds, bounds_in
from dpm_store.maps.tile_files import Key

#: Kinds of products in tiles.
MAPS = ("dem", "navigation_map")
#: Kinds of events that change maps.
KINDS = ("inserted", "deleted", "reanchored")


@dataclass(frozen=True, slots=True)
class Change:
    """A rectangle of a frame, metres, in which maps of a product type, or of any for None, have changed.

    ``is_insertion`` is set if maps were only added.
    """

    frame: str
    bounds: Bounds
    product: str | None = None
    is_insertion: bool = False


class MapChanges:
    """Changes of maps by events.

    Attributes
    ----------
    frames_in_use : set of str
        Frames in which changes are of interest.
    """

    def __init__(self, database: Database, frames: FrameTable, frames_in_use: set[str]) -> None:
        self._database = database
        self._frames = frames
        self.frames_in_use = frames_in_use

    def of(self, event: Event) -> Iterable[Change]:
        """Return the rectangles that an event changes."""
        body = event.body
        if event.kind == "reanchored":
            yield from self._changes_of_revision(int(body["frames_revision"]))
        elif body.get("product") in MAPS and body.get("dfpc") != DERIVED_DFPC and "box_m" in body:
            yield from self._changes_of_map(
                body["product"],
                str(body["frame"]),
                np.array(body["box_m"], dtype=np.float64),
                is_insertion=event.kind == "inserted",
            )

    def _changes_of_revision(self, state: int) -> Iterable[Change]:
        """Return the previous and the new rectangle of the patches that a frame revision moves."""
        with self._database.read() as connection:
            before = self._frames.tree(HistoryView(state=state - 1), connection=connection)
            after = self._frames.tree(HistoryView(state=state), connection=connection)
            map_frames = connection.execute(select(schema.frame_names.c.frame)).scalars().all()
            for map_frame in map_frames:
                box = None
                for frame in sorted(self.frames_in_use):
                    old, new = before.find(frame, map_frame), after.find(frame, map_frame)
                    if old is not None and new is not None and old.equals(new):
                        continue
                    box = _patches_box(connection, map_frame) if box is None else box
                    for T in (old, new):
                        if T is not None and np.isfinite(box).all():
                            yield Change(frame, bounds_in(T, box))

    def _changes_of_map(
        self, product: str, map_frame: str, box: NDArray[np.float64], *, is_insertion: bool
    ) -> Iterable[Change]:
        tree = self._frames.tree()
        for frame in sorted(self.frames_in_use):
            T = tree.find(frame, map_frame)
            if T is not None:
                yield Change(frame, bounds_in(T, box), product, is_insertion)


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
    """Return the box of all maps of a frame, also deleted ones, which tiles may still have; else NaN."""
    p = schema.products.c
    low = func.min(p.xmin_m), func.min(p.ymin_m), func.min(p.zmin_m)
    high = func.max(p.xmax_m), func.max(p.ymax_m), func.max(p.zmax_m)
    conditions = p.frame == frame, p.product.in_(MAPS), p.dfpc != DERIVED_DFPC
    row = connection.execute(select(*low, *high).where(*conditions)).one()
    return np.array([np.nan if v is None else v for v in row], dtype=np.float64)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search: the spatial index names candidates per frame, exact geometry in the region's frame decides.

Products lie in the frame they were made in. A region asked in one frame is carried into every frame that holds
products and that fixed edges join with it; the outline of each candidate is then carried back and compared with the
region in float64. Paging is by keyset (end of capture, ordinal), and a cursor names the state of the frame tree that
its first page was placed by, so that pages neither repeat nor skip when products come and go or sites are re-anchored
in between.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, distinct, or_, select

from cdff_common.clock import NS_PER_S
from cdff_common.geometry.region import Region
from dpm_store import outlines, schema, sqlite
from dpm_store.conditions import conditions, few_with, ordering, plain_conditions
from dpm_store.database import Database
from dpm_store.footprints import rings_in
from dpm_store.frames import FrameTable, FrameTree, Known
from dpm_store.insertion import epoch_ns
from dpm_store.nearest import Nearest
from dpm_store.placing import SIDES, Placed, placed_frames
from dpm_store.poses import PoseTable
from dpm_store.products import RECORD_COLUMNS, ProductTable, record_of
from dpm_store.records import LATEST_NS, Cursor, Order, Page, ProductRecord, Query, read_cursor
from dpm_store.slices import Slice, portions, slices

#: What makes a record, then every other column that a search asks for.
_LISTED = sqlite.listed_products(
    [*RECORD_COLUMNS, *(c.name for c in schema.products.c if c.name not in (*RECORD_COLUMNS, "sha256"))]
)
_ANSWERED = (*RECORD_COLUMNS, "frame", *SIDES)
_RECORD, _FRAME, _BOX = slice(len(RECORD_COLUMNS)), -1 - len(SIDES), slice(-len(SIDES), None)


class Search:
    """Finds products."""

    def __init__(self, database: Database, products: ProductTable, frames: FrameTable, poses: PoseTable) -> None:
        self._database = database
        self._products = products
        self._frames = frames
        self._poses = poses
        self._nearest = Nearest(self)
        self._epoch_ns: int | None = None

    def run(self, query: Query) -> Page:
        """Return one page; see ``Query``.

        Raises
        ------
        FrameNotFoundError, ExtrapolationError
            If the middle of a ``near`` region is not known.
        InputError
            On a cursor of another search.
        """
        with self._database.read() as connection:
            query = _pinned(query)
            tree = self._frames.tree_in(connection, _known(query))
            if query.region is not None and not query.region.is_resolved:
                query = replace(query, region=self.resolved(connection, query))
            if query.order is Order.NEAREST:
                return self._nearest.run(connection, query, tree)
            if query.region is None:
                rows = self._rows(connection, query, query.limit + 1)
                return _page(query, [record_of(row) for row in rows], (), tree)
            return self._run_spatial(connection, query, query.region, tree)

    def resolved_region(self, query: Query) -> Region:
        """The region of a query with ``near`` turned into a circle; see ``resolved``."""
        with self._database.read() as connection:
            return self.resolved(connection, query)

    def resolved(self, connection: Connection, query: Query) -> Region:
        """The region with ``near`` turned into a circle around its frame, where that was at ``t1_ns`` or is newest."""
        region = query.region
        assert region is not None  # callers ask for spatial searches only
        if region.near_frame is None:
            return region
        known = _known(query)
        newest_ns = self._poses.newest_in(connection, query.frame, region.near_frame, known=known) or 0
        stamp_ns = newest_ns if query.t1_ns is None else min(query.t1_ns, newest_ns)
        T = self._poses.at_in(connection, stamp_ns, query.frame, region.near_frame, known=known)
        return region.resolved(float(T.matrix[0, 3]), float(T.matrix[1, 3]))

    def _run_spatial(self, connection: Connection, query: Query, region: Region, tree: FrameTree) -> Page:
        placed, unplaced = placed_frames(connection, tree, query.frame)
        boxes = [(frame.ordinal, box) for frame in placed.values() for box in frame.boxes(region)]
        found: list[ProductRecord] = []
        for part in self._parts(connection, query, boxes):
            rows = _rows_of(connection, query, part)
            kept = self.inside(connection, rows, region, placed)
            found += [ProductRecord._make(row[_RECORD]) for row, keep in zip(rows, kept.tolist(), strict=True) if keep]
            if len(found) > query.limit:
                break
        return _page(query, found, unplaced, tree)

    def _parts(
        self, connection: Connection, query: Query, boxes: Sequence[tuple[int, Sequence[float]]]
    ) -> Iterator[Slice]:
        """Candidates in the query's order, about as many at a time as are wanted."""
        epoch = self._epoch(connection)
        in_buckets = _in_buckets(connection, query, boxes)
        if epoch is None or not in_buckets:
            return
        wanted = query.limit + query.limit // 16 + 1
        newest_first = query.order is not Order.OLDEST
        whole = Slice(LATEST_NS, -LATEST_NS, [])
        for part in slices(connection, query, in_buckets, epoch, wanted):
            after, until = min(whole.after_ns, part.after_ns), max(whole.until_ns, part.until_ns)
            whole = Slice(after, until, whole.found + part.found)
            if len(whole.found) >= wanted:
                yield from portions(whole, wanted, epoch, newest_first=newest_first)
                whole = Slice(LATEST_NS, -LATEST_NS, [])
        if whole.found:
            yield whole

    def candidates(
        self, connection: Connection, query: Query, boxes: Sequence[tuple[int, Sequence[float]]]
    ) -> tuple[Any, dict[str, Any]]:
        """Condition that a product's indexed box touches one of these, each in its frame, and the values it needs.

        None where nothing can: there are no boxes, or no products yet.
        """
        epoch = self._epoch(connection)
        in_buckets = _in_buckets(connection, query, boxes)
        if epoch is None or not in_buckets:
            return None, {}
        t_s = (
            -math.inf if query.t0_ns is None else (query.t0_ns - epoch) / NS_PER_S,
            math.inf if query.t1_ns is None else (query.t1_ns - epoch) / NS_PER_S,
        )
        # what was deleted since lies in an index of its own
        indexes = sqlite.INDEXES[:1] if query.as_of_ns is None else sqlite.INDEXES
        ordinal = schema.products.c.ordinal
        touching = or_(*(ordinal.in_(sqlite.candidates(index)) for index in indexes))
        return touching, sqlite.candidate_values(in_buckets, t_s)

    def _epoch(self, connection: Connection) -> int | None:
        if self._epoch_ns is None:  # set by the first product, and never changed
            self._epoch_ns = epoch_ns(connection)
        return self._epoch_ns

    @staticmethod
    def _rows(connection: Connection, query: Query, limit: int) -> Sequence[Any]:
        """Rows of products in the query's order, wherever they are."""
        few = few_with(connection, query.metrics)
        source, values = (schema.products.c, {}) if few is None else (_LISTED.c, {"ordinals": sqlite.list_value(few)})
        statement = select(*(source[name] for name in RECORD_COLUMNS)).where(*conditions(query, source))
        return connection.execute(statement.order_by(*ordering(query, source)).limit(limit), values).all()

    @staticmethod
    def inside(
        connection: Connection, rows: Sequence[Any], region: Region, placed: dict[str, Placed]
    ) -> NDArray[np.bool_]:
        """Tell which rows' outlines touch the region; a row begins with the ordinal and ends with frame and box."""
        keep = np.zeros(len(rows), dtype=bool)
        of_frame: dict[str, list[int]] = {}
        for i, row in enumerate(rows):
            of_frame.setdefault(row[_FRAME], []).append(i)
        for name, those in of_frame.items():
            boxes = np.array([rows[i][_BOX] for i in those])
            keep[those] = outlines.touches(region, boxes, placed[name].matrix)
        rings = rings_in(connection, [rows[i][0] for i in np.flatnonzero(keep).tolist()])
        if not rings:
            return keep
        for name, those in of_frame.items():
            ringed = [i for i in those if keep[i] and rows[i][0] in rings]
            if ringed:
                heights = np.array([rows[i][_BOX][2::3] for i in ringed])
                outline = [rings[rows[i][0]] for i in ringed]
                keep[ringed] = outlines.footprints_touch(region, outline, heights, placed[name].matrix)
        return keep


def _rows_of(connection: Connection, query: Query, part: Slice) -> Sequence[Any]:
    """Those of a slice's candidates that the query asks for, in its order."""
    values: dict[str, Any] = {"ordinals": sqlite.list_value(part.ordinals)}
    plain = plain_conditions(query)
    if plain is not None:
        where, asked = plain
        where += ["t1_ns > :after_ns", "t1_ns <= :until_ns"]
        values |= asked | {"after_ns": part.after_ns, "until_ns": part.until_ns}
        order = "t1_ns, ordinal" if query.order is Order.OLDEST else "t1_ns DESC, ordinal DESC"
        return sqlite.listed_rows(connection, _ANSWERED, where, order, values)
    p = _LISTED.c
    statement = select(*(p[name] for name in _ANSWERED)).order_by(*ordering(query, p))
    return connection.execute(
        statement.where(*conditions(query, p), p.t1_ns > part.after_ns, p.t1_ns <= part.until_ns), values
    ).all()


def types_present(connection: Connection) -> list[str]:
    """The kinds of product that are in the store."""
    p = schema.products.c
    statement = select(distinct(p.product)).where(p.deleted_ns.is_(None)).order_by(p.product)
    return list(connection.execute(statement).scalars())


def _in_buckets(
    connection: Connection, query: Query, boxes: Sequence[tuple[int, Sequence[float]]]
) -> list[sqlite.IndexBox]:
    """Boxes in frames as the index names them: one for each of the query's types that the frame holds."""
    frames = {frame for frame, _ in boxes}
    found = sqlite.buckets(connection)
    return [
        (bucket, box)
        for bucket, frame, product in found
        if frame in frames and (not query.types or product in query.types)
        for in_frame, box in boxes
        if in_frame == frame
    ]


def _pinned(query: Query) -> Query:
    """The query with the state of the frame tree that its first page was placed by."""
    if query.cursor is None:
        return query
    return replace(query, frames_revision=read_cursor(query.cursor, query.order).frames_revision)


def _known(query: Query) -> Known:
    return Known(query.as_of_ns, query.frames_revision)


def _page(query: Query, found: list[ProductRecord], unplaced: tuple[str, ...], tree: FrameTree) -> Page:
    items = tuple(found[: query.limit])
    cursor = None
    if len(found) > query.limit:
        cursor = Cursor(query.order, items[-1].t1_ns, items[-1].ordinal, tree.state).text
    return Page(items, cursor, unplaced, tree.state)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search: the spatial index returns candidates per frame, which are compared exactly in the region's frame.

Products stay in the frame of their production. A region is transformed into every frame that holds products
and is connected by fixed edges; the outline of each candidate is transformed back and compared with the
region in float64. Paging is by keyset (end of capture, ordinal), and a cursor contains the state of the frame
tree of its first page, so that pages neither repeat nor skip products after insertions, deletions or
re-anchoring.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, false, func, or_, select

from cdff_common.clock import NS_PER_S, monotonic_s
from cdff_common.contract.limits import LATEST_NS, MAX_PAGE
from cdff_common.errors import InputError
from cdff_common.geometry.region import Region
from cdff_common.geometry.se3 import FloatArray
from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.engine.dialect import IndexBox
from dpm_store.engine.time_limit import time_left_s
from dpm_store.frames.frames import NEWEST, FrameTable, FrameTree, HistoryView
from dpm_store.frames.poses import PoseTable
from dpm_store.frames.resolved_frames import FRAMES, ResolvedFrame, resolve_frames
from dpm_store.products.insertion import epoch_ns
from dpm_store.products.products import RECORD_COLUMNS, ProductTable, record_of
from dpm_store.products.records import Cursor, Order, Page, ProductRecord, Query, read_cursor
from dpm_store.search import outlines
from dpm_store.search.conditions import conditions, constant_statement, few_within, ordering
from dpm_store.search.footprints import rings_in, rings_of, rings_statement
from dpm_store.search.nearest import NearestSearch
from dpm_store.search.slices import ENDS, Slice, portions, slices
from dpm_store.search.sorted_pages import sorted_page

#: Columns that conditions and results of a search use.
_COLUMNS = (
    *RECORD_COLUMNS,
    *(c.name for c in schema.products.c if c.name not in (*RECORD_COLUMNS, "sha256")),
)
_SELECTED = (*RECORD_COLUMNS, "frame", *schema.SIDES)
#: Longest time of a search with an expression or in another order than that of time, seconds.
_LONGEST_S = 20.0
#: Columns that decide whether a product is in a region.
_PLACED = ("ordinal", "frame", *schema.SIDES)
_RECORD, _FRAME, _BOX = slice(len(RECORD_COLUMNS)), -1 - len(schema.SIDES), slice(-len(schema.SIDES), None)
_b = schema.index_buckets.c
_BUCKETS = select(_b.ordinal, _b.frame, _b.product)


class Search:
    """Search for products."""

    def __init__(
        self, database: Database, products: ProductTable, frames: FrameTable, poses: PoseTable
    ) -> None:
        self._database = database
        self._dialect = database.dialect
        self._products = products
        self._frames = frames
        self._poses = poses
        self._nearest = NearestSearch(self)
        self._listed = self._dialect.listed_products(_COLUMNS)
        self._epoch_ns: int | None = None

    def run(self, query: Query | None = None) -> Page:
        """Return one page of results; see ``Query``.

        Raises
        ------
        FrameNotFoundError, ExtrapolationError
            If the centre of a ``near`` region is not known.
        InputError
            If the cursor is of another search.
        """
        query = _with_state_of_cursor(query or Query())
        with self._database.read() as connection, self._limited(connection, query):
            if query.region is not None:
                self._dialect.fetch_ahead(connection, (NEWEST, FRAMES, _BUCKETS, ENDS))
            tree = self._frames.tree(_view(query), connection=connection)
            if query.region is not None and not query.region.is_resolved:
                query = replace(query, region=self.resolved_region(query, connection=connection))
            if query.sort:
                return sorted_page(connection, query, tree.state)
            if query.order is Order.NEAREST:
                return self._nearest.run(connection, query, tree)
            if query.region is None:
                rows = self._rows(connection, query, query.limit + 1)
                return _page(query, [record_of(row) for row in rows], (), tree)
            return self._run_spatial(connection, query, query.region, tree)

    def count(self, query: Query) -> int:
        """Return the number of products on all pages of a query without a region."""
        if query.region is not None:
            raise InputError(f"count: region={query.region.text}, expected a query without a region")
        source = schema.products.c
        with self._database.read() as connection, self._limited(connection, query):
            few = few_within(connection, query.metrics)
            where = conditions(replace(query, cursor=None), self._dialect, source)
            if few is not None:
                where.append(source.ordinal.in_(few))
            return int(connection.execute(select(func.count()).where(*where)).scalar_one())

    def ordinals_in(self, query: Query, most: int) -> set[int] | None:
        """Return the ordinals of the products on all pages of a query with a region, None if they are more
        than ``most``.
        """
        query = replace(query, cursor=None, sort=(), limit=MAX_PAGE)
        assert query.region is not None
        ordinals: set[int] = set()
        with self._database.read() as connection, self._limited(connection, query):
            tree = self._frames.tree(_view(query), connection=connection)
            resolved, _ = resolve_frames(connection, tree, query.frame)
            boxes = [(frame.ordinal, box) for frame in resolved.values() for box in frame.boxes(query.region)]
            for candidates in self._slices(connection, query, boxes):
                rows, rings = self._rows_of(connection, query, candidates, _PLACED)
                inside_flags = self.inside(connection, rows, query.region, resolved, rings)
                ordinals.update(
                    row[0] for row, inside in zip(rows, inside_flags.tolist(), strict=True) if inside
                )
                if len(ordinals) > most:
                    return None
        return ordinals

    def resolved_region(self, query: Query, *, connection: Connection | None = None) -> Region:
        """Return the region of a query with ``near`` replaced by a circle.

        The circle is around the frame at ``t1_ns``, or at the newest time.
        """
        region = query.region
        assert region is not None
        if region.near_frame is None:
            return region
        frames, view = (query.frame, region.near_frame), _view(query)
        with self._database.read(connection) as connection:
            newest_ns = self._poses.newest_ns(*frames, view=view, connection=connection) or 0
            stamp_ns = newest_ns if query.t1_ns is None else min(query.t1_ns, newest_ns)
            T = self._poses.at(stamp_ns, *frames, view=view, connection=connection)
        return region.resolved(float(T.matrix[0, 3]), float(T.matrix[1, 3]))

    def _limited(self, connection: Connection, query: Query) -> AbstractContextManager[None]:
        """Limit the time of a search that callers can make arbitrarily slow."""
        if query.where is None and not query.sort:
            return nullcontext()
        end_s = monotonic_s() + time_left_s(_LONGEST_S)
        return self._dialect.interruptible(connection, lambda: monotonic_s() > end_s)

    def _run_spatial(self, connection: Connection, query: Query, region: Region, tree: FrameTree) -> Page:
        """Return the page of products whose outline intersects a region, tested slice by slice."""
        resolved, unplaced = resolve_frames(connection, tree, query.frame)
        boxes = [(frame.ordinal, box) for frame in resolved.values() for box in frame.boxes(region)]
        records: list[ProductRecord] = []
        for candidates in self._slices(connection, query, boxes):
            rows, rings = self._rows_of(connection, query, candidates)
            inside_flags = self.inside(connection, rows, region, resolved, rings)
            records += [
                ProductRecord._make(row[_RECORD])
                for row, is_inside in zip(rows, inside_flags.tolist(), strict=True)
                if is_inside
            ]
            if len(records) > query.limit:
                break
        return _page(query, records, unplaced, tree)

    def _slices(
        self, connection: Connection, query: Query, boxes: Sequence[tuple[int, Sequence[float]]]
    ) -> Iterator[Slice]:
        """Yield candidates in the query's order, in slices of about as many as the page needs."""
        epoch = self._epoch(connection)
        index_boxes = self._index_boxes(connection, query, boxes)
        if epoch is None or not index_boxes:
            return
        count = query.limit + query.limit // 16 + 1
        newest_first = query.order is not Order.OLDEST
        collected = Slice(LATEST_NS, -LATEST_NS, [])
        for piece in slices(connection, query, index_boxes, epoch, count):
            after, until = min(collected.after_ns, piece.after_ns), max(collected.until_ns, piece.until_ns)
            collected = Slice(after, until, collected.entries + piece.entries)
            if len(collected.entries) >= count:
                yield from portions(collected, count, epoch, self._dialect, newest_first=newest_first)
                collected = Slice(LATEST_NS, -LATEST_NS, [])
        if collected.entries:
            yield collected

    def candidates(
        self, connection: Connection, query: Query, boxes: Sequence[tuple[int, Sequence[float]]]
    ) -> tuple[Any, dict[str, Any]]:
        """Return the condition that a product's indexed box may overlap one of these, and its values.

        The condition is false without boxes or without products.
        """
        epoch = self._epoch(connection)
        index_boxes = self._index_boxes(connection, query, boxes)
        if epoch is None or not index_boxes:
            return false(), {}
        t_s = (
            -math.inf if query.t0_ns is None else (query.t0_ns - epoch) / NS_PER_S,
            math.inf if query.t1_ns is None else (query.t1_ns - epoch) / NS_PER_S,
        )
        # products that were deleted since are in a separate index
        indexes = self._dialect.INDEXES[:1] if query.as_of_ns is None else self._dialect.INDEXES
        ordinal = schema.products.c.ordinal
        overlapping = or_(*(ordinal.in_(self._dialect.candidates(index)) for index in indexes))
        return overlapping, self._dialect.candidate_values(index_boxes, t_s)

    def _epoch(self, connection: Connection) -> int | None:
        if self._epoch_ns is None:  # set by the first product, then constant
            self._epoch_ns = epoch_ns(connection)
        return self._epoch_ns

    def _rows(self, connection: Connection, query: Query, limit: int) -> Sequence[Any]:
        """Return rows of products in the query's order, without a region."""
        few = few_within(connection, query.metrics)
        source: Any = schema.products.c
        values: dict[str, Any] = {}
        if few is not None:
            source, values = self._listed.c, {"ordinals": self._dialect.list_value(few)}
        where = conditions(query, self._dialect, source)
        if query.where is not None:  # the order of many products is found without their headers
            ordinal_query = (
                select(source.ordinal).where(*where).order_by(*ordering(query.order, source)).limit(limit)
            )
            ordinals = list(connection.execute(ordinal_query, values).scalars())
            source, values, where = self._listed.c, {"ordinals": self._dialect.list_value(ordinals)}, []
        statement = select(*(source[name] for name in RECORD_COLUMNS)).where(*where)
        return connection.execute(
            statement.order_by(*ordering(query.order, source)).limit(limit), values
        ).all()

    @staticmethod
    def inside(
        connection: Connection,
        rows: Sequence[Any],
        region: Region,
        resolved: dict[str, ResolvedFrame],
        rings: dict[int, FloatArray] | None = None,
    ) -> NDArray[np.bool_]:
        """Return which outlines touch the region; rows start with the ordinal and end with frame and box.

        ``rings`` are those of all rows that have one; they are read if they are not given.
        """
        touching = np.zeros(len(rows), dtype=bool)
        uncertain = np.zeros(len(rows), dtype=bool)  # the box touches the edge of the region
        of_frame: dict[str, list[int]] = {}
        for i, row in enumerate(rows):
            of_frame.setdefault(row[_FRAME], []).append(i)
        for name, indices in of_frame.items():
            boxes = np.array([rows[i][_BOX] for i in indices])
            touching[indices] = outlines.touches(region, boxes, resolved[name].matrix)
            uncertain[indices] = touching[indices] & ~outlines.contains(region, boxes, resolved[name].matrix)
        if rings is None:
            rings = rings_in(connection, [rows[i][0] for i in np.flatnonzero(uncertain).tolist()])
        if not rings:
            return touching
        for name, indices in of_frame.items():
            ringed = [i for i in indices if uncertain[i] and rows[i][0] in rings]
            if ringed:
                heights = np.array([rows[i][_BOX][2::3] for i in ringed])
                outline = [rings[rows[i][0]] for i in ringed]
                touching[ringed] = outlines.footprints_touch(region, outline, heights, resolved[name].matrix)
        return touching

    def _rows_of(
        self,
        connection: Connection,
        query: Query,
        candidates: Slice,
        columns: tuple[str, ...] = _SELECTED,
    ) -> tuple[Sequence[Any], dict[int, FloatArray] | None]:
        """Return the candidates of a slice that match the query, in its order, and rings read with them."""
        ordinals = {"ordinals": self._dialect.list_value(candidates.ordinals)}
        constant = constant_statement(query, self._listed, columns)
        if constant is not None:
            statement, values = constant
            bounds = {"after_ns": candidates.after_ns, "until_ns": candidates.until_ns}
            call = (statement, values | ordinals | bounds)
            if not self._dialect.is_shared:
                return self._dialect.fetch(connection, *call), None
            calls = (call, rings_statement(connection, candidates.ordinals))
            found, rings = self._dialect.fetch_together(connection, calls)
            return found, rings_of(rings)
        p = self._listed.c
        rows = select(*(p[name] for name in columns)).order_by(*ordering(query.order, p))
        rows = rows.where(
            *conditions(query, self._dialect, p),
            p.t1_ns > candidates.after_ns,
            p.t1_ns <= candidates.until_ns,
        )
        return connection.execute(rows, ordinals).all(), None

    def _index_boxes(
        self, connection: Connection, query: Query, boxes: Sequence[tuple[int, Sequence[float]]]
    ) -> list[IndexBox]:
        """Return the boxes to search in the spatial index, as (bucket, box).

        A bucket is the part of the index for one frame and one product type; each box is repeated for every
        bucket of its frame that the query's types select.
        """
        frames = {frame for frame, _ in boxes}
        return [
            (bucket, box)
            for bucket, frame, product in self._dialect.fetch(connection, _BUCKETS)
            if frame in frames and (not query.types or product in query.types)
            for in_frame, box in boxes
            if in_frame == frame
        ]


def _with_state_of_cursor(query: Query) -> Query:
    """Return the query with the state of the frame tree of its first page."""
    if query.cursor is None or query.sort:
        return query
    return replace(query, frames_revision=read_cursor(query.cursor, query.order).frames_revision)


def _view(query: Query) -> HistoryView:
    return HistoryView(query.as_of_ns, query.frames_revision)


def _page(query: Query, records: list[ProductRecord], unplaced: tuple[str, ...], tree: FrameTree) -> Page:
    items = tuple(records[: query.limit])
    cursor = None
    if len(records) > query.limit:
        cursor = Cursor(query.order, items[-1].t1_ns, items[-1].ordinal, tree.state).text
    return Page(items, cursor, unplaced, tree.state)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search in the order of the distance from a point, without reading all products.

The distance is from the point to the product's outline in the plane, 0 inside; equal distances are ordered
from the newest. The spatial index is searched in squares around the point, which grow until they contain
enough products and shrink if they contain too many: the products within half the side are then complete.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from dpm_store.engine import schema
from dpm_store.engine.database import dialect_of
from dpm_store.frames.frames import FrameTree
from dpm_store.frames.resolved_frames import ResolvedFrame, resolve_frames
from dpm_store.products.products import record_of
from dpm_store.products.records import Cursor, Order, Page, Query, read_cursor
from dpm_store.search import outlines
from dpm_store.search.conditions import conditions
from dpm_store.search.footprints import rings_in

if TYPE_CHECKING:
    from dpm_store.search.search import Search

#: A square with more than this many times the required products is shrunk.
_TOO_MANY = 8
#: Half the side of the first square, metres, and the factor by which a square grows.
_FIRST_M, _GROWTH = 2.0, 8.0
#: Largest distance of a product from a point.
_FARTHEST_M = 1e10
#: Largest number of times that a square is shrunk: products may have the same position.
_MAX_REDUCTIONS = 40
#: Distances within this ratio count as equal.
_EQUAL = 1.0 + 1e-6

#: Distance, negative end of capture and negative ordinal of a product.
Position = tuple[float, int, int]


class NearestSearch:
    """Search in the order ``nearest``."""

    def __init__(self, search: Search) -> None:
        self._search = search

    def run(self, connection: Connection, query: Query, tree: FrameTree) -> Page:
        """Return one page; a region of the query must be resolved."""
        assert query.point is not None or query.region is not None  # checked by Query
        point = query.point or (query.region.centre if query.region is not None else (0.0, 0.0))
        frames, unplaced = resolve_frames(connection, tree, query.frame)
        cursor = None if query.cursor is None else read_cursor(query.cursor, Order.NEAREST)
        after: Position | None = (
            None if cursor is None else (cursor.distance_m, -cursor.t1_ns, -cursor.ordinal)
        )
        squares = _Squares(self._search, connection, query, point, frames, after)
        before = 0 if cursor is None else cursor.count
        positions = squares.first(query.limit + 1, before)
        items, rows = positions[: query.limit], {}
        if items:
            p = schema.products.c
            statement = select(schema.products).where(p.ordinal.in_([-position[2] for position in items]))
            rows = {row.ordinal: row for row in connection.execute(statement)}
        text = None
        if len(positions) > query.limit:
            distance_m, t1, ordinal = items[-1]
            text = Cursor(Order.NEAREST, -t1, -ordinal, tree.state, distance_m, before + len(items)).text
        records = tuple(record_of(rows[-position[2]]) for position in items)
        return Page(records, text, unplaced, tree.state, tuple(position[0] for position in items))


class _Squares:
    """Positions of the products of a query in squares around a point."""

    def __init__(
        self,
        search: Search,
        connection: Connection,
        query: Query,
        point: tuple[float, float],
        frames: dict[str, ResolvedFrame],
        after: Position | None,
    ) -> None:
        self._search = search
        self._connection = connection
        self._query = query
        self._point = point
        self._frames = frames
        self._after = after

    def first(self, count: int, before: int) -> list[Position]:
        """Return the first positions after the cursor, in order.

        ``before`` is the number of products before the cursor, which are also candidates.
        """
        limit = _TOO_MANY * count + 2 * before + 1
        lower, upper, reductions = 0.0, math.inf, 0
        reach = _FIRST_M if self._after is None else max(_FIRST_M, 2.0 * self._after[0])
        while True:
            rows = self._rows(reach, limit)
            if len(rows) == limit:
                reductions += 1
                if reductions < _MAX_REDUCTIONS and reach > lower * _EQUAL:
                    upper = reach
                    reach = math.sqrt(lower * upper) if lower > 0.0 else upper / _GROWTH
                    continue
                rows = self._rows(reach, None)  # very many at one distance: all must be compared
                limit = max(limit, 2 * len(rows))
            positions = self._within(rows, reach)
            if len(positions) >= count or reach >= _FARTHEST_M:
                return positions[:count]
            lower = reach
            if upper > lower * _EQUAL and upper < math.inf:
                reach = math.sqrt(lower * upper)
            else:
                reach, upper = min(lower * _GROWTH, _FARTHEST_M), math.inf

    def _rows(self, reach: float, limit: int | None) -> Sequence[Any]:
        """Return the candidates whose box touches the square, without their headers."""
        (x, y), p = self._point, schema.products.c
        square = (x - reach, y - reach, -math.inf, x + reach, y + reach, math.inf)
        boxes = [(f.ordinal, box) for f in self._frames.values() if (box := f.box(square)) is not None]
        where, values = self._search.candidates(self._connection, self._query, boxes)
        sides = [p[side] for side in schema.SIDES]
        matching = conditions(self._query, dialect_of(self._connection))
        statement = select(p.ordinal, p.t1_ns, p.frame, *sides).where(*matching, where)
        return self._connection.execute(statement if limit is None else statement.limit(limit), values).all()

    def _within(self, rows: Sequence[Any], reach: float) -> list[Position]:
        """Return the positions within the reach, inside the region and after the cursor, in order."""
        if not rows:
            return []
        distances = self._distances(rows)
        is_match = distances <= reach
        if self._query.region is not None:
            is_match &= self._search.inside(self._connection, rows, self._query.region, self._frames)
        positions = [
            (float(distances[i]), -int(rows[i].t1_ns), -int(rows[i].ordinal))
            for i in np.flatnonzero(is_match).tolist()
        ]
        return sorted(p for p in positions if self._after is None or p > self._after)

    def _distances(self, rows: Sequence[Any]) -> NDArray[np.float64]:
        """Return the distances (n,) of products from the point: to their footprint, otherwise to their box,
        metres.
        """
        distances = np.empty(len(rows))
        rings = rings_in(self._connection, (row.ordinal for row in rows))
        for name in {row.frame for row in rows}:
            matrix = self._frames[name].matrix
            boxed = [i for i, row in enumerate(rows) if row.frame == name and row.ordinal not in rings]
            ringed = [i for i, row in enumerate(rows) if row.frame == name and row.ordinal in rings]
            if boxed:
                boxes = np.array([[getattr(rows[i], side) for side in schema.SIDES] for i in boxed])
                distances[boxed] = outlines.distances_m(self._point, boxes, matrix)
            if ringed:
                heights = np.array([[rows[i].zmin_m, rows[i].zmax_m] for i in ringed])
                outline = [rings[rows[i].ordinal] for i in ringed]
                distances[ringed] = outlines.footprint_distances_m(self._point, outline, heights, matrix)
        return distances

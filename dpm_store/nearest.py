# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products in the order of their distance from a point, without looking at all of them.

The distance is that from the point to a product's outline in the plane, 0 inside; of equals the newest comes first.
Squares around the point are asked of the spatial index, growing until they hold enough and cut back where they hold
far too many: what lies within the square's half side is then complete and in order.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from dpm_store import outlines, schema
from dpm_store.conditions import conditions
from dpm_store.footprints import rings_in
from dpm_store.frames import FrameTree
from dpm_store.placing import SIDES, Placed, placed_frames
from dpm_store.products import record_of
from dpm_store.records import Cursor, Order, Page, Query, read_cursor

if TYPE_CHECKING:
    from dpm_store.search import Search

#: A square that holds more than so many times the products wanted is cut back.
_TOO_MANY = 8
_FIRST_M, _GROWTH = 2.0, 8.0
#: No product lies farther from a point than this.
_FARTHEST_M = 1e10
_CUTS = 40
#: Distances in this proportion are not told apart.
_ALIKE = 1.0 + 1e-6

Place = tuple[float, int, int]


class Nearest:
    """Runs searches in the order ``nearest``."""

    def __init__(self, search: Search) -> None:
        self._search = search

    def run(self, connection: Connection, query: Query, tree: FrameTree) -> Page:
        """One page; the query's region, where it has one, is resolved."""
        assert query.point is not None or query.region is not None  # the query says so
        point = query.point or (query.region.centre if query.region is not None else (0.0, 0.0))
        placed, unplaced = placed_frames(connection, tree, query.frame)
        cursor = None if query.cursor is None else read_cursor(query.cursor, Order.NEAREST)
        after: Place | None = None if cursor is None else (cursor.distance_m, -cursor.t1_ns, -cursor.ordinal)
        look = _Look(self._search, connection, query, point, placed, after)
        before = 0 if cursor is None else cursor.count
        found = look.first(query.limit + 1, before)
        items, rows = found[: query.limit], {}
        if items:
            p = schema.products.c
            wanted = select(schema.products).where(p.ordinal.in_([-place[2] for place in items]))
            rows = {row.ordinal: row for row in connection.execute(wanted)}
        text = None
        if len(found) > query.limit:
            distance_m, t1, ordinal = items[-1]
            text = Cursor(Order.NEAREST, -t1, -ordinal, tree.state, distance_m, before + len(items)).text
        records = tuple(record_of(rows[-place[2]]) for place in items)
        return Page(records, text, unplaced, tree.state, tuple(place[0] for place in items))


class _Look:
    """The places ``(distance, -t1, -ordinal)`` of what a query finds around a point."""

    def __init__(
        self, search: Search, connection: Connection, query: Query, point: tuple[float, float],
        placed: dict[str, Placed], after: Place | None,
    ) -> None:  # fmt: skip
        self._search = search
        self._connection = connection
        self._query = query
        self._point = point
        self._placed = placed
        self._after = after

    def first(self, wanted: int, before: int) -> list[Place]:
        """The first places after the cursor, in order; fewer where there are no more.

        ``before`` is how many come before the cursor: they are candidates too, and allowed for.
        """
        most = _TOO_MANY * wanted + 2 * before + 1
        near, far, cuts = 0.0, math.inf, 0
        reach = _FIRST_M if self._after is None else max(_FIRST_M, 2.0 * self._after[0])
        while True:
            rows = self._rows(reach, most)
            if len(rows) == most:
                cuts += 1
                if cuts < _CUTS and reach > near * _ALIKE:
                    far = reach
                    reach = math.sqrt(near * far) if near > 0.0 else far / _GROWTH
                    continue
                rows = self._rows(reach, None)  # very many at one distance: all of them must be looked at
                most = max(most, 2 * len(rows))
            found = self._within(rows, reach)
            if len(found) >= wanted or reach >= _FARTHEST_M:
                return found[:wanted]
            near = reach
            if far > near * _ALIKE and far < math.inf:
                reach = math.sqrt(near * far)
            else:
                reach, far = min(near * _GROWTH, _FARTHEST_M), math.inf

    def _rows(self, reach: float, most: int | None) -> Sequence[Any]:
        """Candidates whose box touches the square, without their headers."""
        (x, y), p = self._point, schema.products.c
        square = (x - reach, y - reach, -math.inf, x + reach, y + reach, math.inf)
        boxes = [(f.ordinal, box) for f in self._placed.values() if (box := f.box(square)) is not None]
        where, values = self._search.candidates(self._connection, self._query, boxes)
        if where is None:
            return ()
        sides = [p[side] for side in SIDES]
        statement = select(p.ordinal, p.t1_ns, p.frame, *sides).where(*conditions(self._query), where)
        return self._connection.execute(statement if most is None else statement.limit(most), values).all()

    def _within(self, rows: Sequence[Any], reach: float) -> list[Place]:
        """Places of rows no farther than the reach, inside the region and after the cursor, in order."""
        if not rows:
            return []
        distances = self._distances(rows)
        keep = distances <= reach
        if self._query.region is not None:
            keep &= self._search.inside(self._connection, rows, self._query.region, self._placed)
        places = [
            (float(distances[i]), -int(rows[i].t1_ns), -int(rows[i].ordinal)) for i in np.flatnonzero(keep).tolist()
        ]
        return sorted(place for place in places if self._after is None or place > self._after)

    def _distances(self, rows: Sequence[Any]) -> NDArray[np.float64]:
        found = np.empty(len(rows))
        rings = rings_in(self._connection, (row.ordinal for row in rows))
        for name in {row.frame for row in rows}:
            matrix = self._placed[name].matrix
            plain = [i for i, row in enumerate(rows) if row.frame == name and row.ordinal not in rings]
            ringed = [i for i, row in enumerate(rows) if row.frame == name and row.ordinal in rings]
            if plain:
                boxes = np.array([[getattr(rows[i], side) for side in SIDES] for i in plain])
                found[plain] = outlines.distances_m(self._point, boxes, matrix)
            if ringed:
                heights = np.array([[rows[i].zmin_m, rows[i].zmax_m] for i in ringed])
                outline = [rings[rows[i].ordinal] for i in ringed]
                found[ringed] = outlines.footprint_distances_m(self._point, outline, heights, matrix)
        return found

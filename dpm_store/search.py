# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search: the spatial index names candidates per frame, exact geometry in the region's frame decides.

Products lie in the frame they were made in. A region asked in one frame is carried into every frame that holds
products and that fixed edges join with it; the box of each candidate is then carried back, and its outline compared
with the region in float64. Paging is by keyset (end of capture, ordinal), so that pages neither repeat nor skip when
products come and go in between.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, and_, distinct, or_, select, tuple_

from cdff_common.clock import NS_PER_S
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.region import Region
from dpm_store import schema, sqlite
from dpm_store.annotations import carries, has_successor
from dpm_store.database import Database
from dpm_store.frames import IDENTITY, FrameTable, Known
from dpm_store.poses import PoseTable
from dpm_store.products import ProductTable, record_of
from dpm_store.records import Page, ProductRecord, Query, make_cursor, read_cursor

_CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=bool)
#: Of the bounds of candidates, relative: rounding must not lose one that the exact comparison would keep.
_SLACK = 1e-6
_SIDES = ("xmin_m", "ymin_m", "zmin_m", "xmax_m", "ymax_m", "zmax_m")


class Search:
    """Finds products."""

    def __init__(self, database: Database, products: ProductTable, frames: FrameTable, poses: PoseTable) -> None:
        self._database = database
        self._products = products
        self._frames = frames
        self._poses = poses
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
            if query.region is None:
                rows = self._rows(connection, query, [], {}, query.limit + 1)
                return _page(query, [record_of(row) for row in rows], ())
            return self._run_spatial(connection, query, self.resolved(connection, query))

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
        newest_ns = self._poses.newest_in(connection, query.frame, region.near_frame) or 0
        stamp_ns = newest_ns if query.t1_ns is None else min(query.t1_ns, newest_ns)
        T = self._poses.at_in(connection, stamp_ns, query.frame, region.near_frame)
        return region.resolved(float(T.matrix[0, 3]), float(T.matrix[1, 3]))

    def _run_spatial(self, connection: Connection, query: Query, region: Region) -> Page:
        transforms, unplaced = self._placed_frames(connection, query.frame, query.as_of_ns)
        if self._epoch_ns is None:  # set by the first product, and never changed
            self._epoch_ns = self._products.epoch_ns(connection)
        epoch = self._epoch_ns
        if epoch is None or not transforms:
            return Page((), None, unplaced)
        t_s = (
            -math.inf if query.t0_ns is None else (query.t0_ns - epoch) / NS_PER_S,
            math.inf if query.t1_ns is None else (query.t1_ns - epoch) / NS_PER_S,
        )
        subqueries: list[Any] = []
        values: dict[str, float] = {}
        for ordinal, T_query_frame in transforms.values():
            bounds = self._bounds_in(connection, region, ordinal, T_query_frame)
            if bounds is not None:
                subquery, bound = sqlite.candidates(ordinal, bounds, t_s, f"f{ordinal}_")
                subqueries.append(schema.products.c.ordinal.in_(subquery))
                values |= bound
        if query.as_of_ns is not None:  # the index has none that were deleted since: their rows are compared
            p = schema.products.c
            subqueries.append(and_(p.deleted_ns.is_not(None), p.xmin_m.is_not(None), p.frame.in_(transforms)))
        if not subqueries:
            return Page((), None, unplaced)
        found: list[ProductRecord] = []
        batch, step = query.limit + 1, query
        while len(found) <= query.limit:
            rows = self._rows(connection, step, [or_(*subqueries)], values, batch)
            found += _inside(rows, region, transforms)
            if len(rows) < batch:
                break
            step = replace(step, cursor=make_cursor(query.oldest_first, rows[-1].t1_ns, rows[-1].ordinal))
            batch = min(4 * batch, 4096)
        return _page(query, found, unplaced)

    def _rows(
        self, connection: Connection, query: Query, extra: list[Any], values: dict[str, float], limit: int
    ) -> Sequence[Any]:
        p = schema.products.c
        order = (p.t1_ns, p.ordinal) if query.oldest_first else (p.t1_ns.desc(), p.ordinal.desc())
        statement = select(schema.products).where(*_conditions(query), *extra).order_by(*order).limit(limit)
        return connection.execute(statement, values).all()

    def _placed_frames(
        self, connection: Connection, frame: str, as_of_ns: int | None
    ) -> tuple[dict[str, tuple[int, UncertainTransform]], tuple[str, ...]]:
        """Frames that hold products: ordinal and ``T_query_frame`` of those that can be placed; names of the rest."""
        placed: dict[str, tuple[int, UncertainTransform]] = {}
        unplaced = []
        tree = self._frames.tree_in(connection, Known(as_of_ns))
        for row in connection.execute(select(schema.frame_names).order_by(schema.frame_names.c.frame)):
            T = tree.find(frame, row.frame)
            if T is None:
                unplaced.append(row.frame)
            else:
                placed[row.frame] = (row.ordinal, T)
        return placed, tuple(unplaced)

    def _bounds_in(
        self, connection: Connection, region: Region, ordinal: int, T_query_frame: UncertainTransform
    ) -> tuple[float, ...] | None:
        """Box around the region in a frame's own coordinates; a free z is closed by what the frame holds."""
        box = region.box_m
        matrix = T_query_frame.matrix
        if T_query_frame is IDENTITY:
            return box
        if math.isinf(box[2]):
            heights = sqlite.frame_bounds(connection, ordinal)
            if heights is None:
                return None
            return _free_height_bounds(box, matrix, heights)
        corners = _corners(np.array([box]))[0]
        inverse = T_query_frame.inverse().apply(corners)
        slack = _SLACK * (1.0 + float(np.abs(inverse).max()))
        return (*(inverse.min(axis=0) - slack), *(inverse.max(axis=0) + slack))


def types_present(connection: Connection) -> list[str]:
    """The kinds of product that are in the store."""
    p = schema.products.c
    statement = select(distinct(p.product)).where(p.deleted_ns.is_(None)).order_by(p.product)
    return list(connection.execute(statement).scalars())


def _conditions(query: Query) -> list[Any]:
    p = schema.products.c
    found: list[Any] = [p.deleted_ns.is_(None)]
    if query.as_of_ns is not None:
        known = query.as_of_ns
        found = [p.inserted_ns <= known, or_(p.deleted_ns.is_(None), p.deleted_ns > known)]
    found += [carries(p.id, tag, query.as_of_ns) for tag in query.tags]
    if query.superseded is not None:
        has = has_successor(p.id, query.as_of_ns)
        found.append(has if query.superseded else ~has)
    if query.types:
        found.append(p.product.in_(query.types))
    wanted = {name: getattr(query, name) for name in ("robot", "dfpc", "port", "status", "child", "config_hash")}
    found += [p[name] == value for name, value in wanted.items() if value is not None]
    if query.t0_ns is not None:
        found.append(p.t1_ns >= query.t0_ns)
    if query.t1_ns is not None:
        found.append(p.t0_ns <= query.t1_ns)
    if query.resolution_max_m is not None:
        found.append(p.resolution_m <= query.resolution_max_m)
    if query.inserted_after is not None:
        found.append(p.ordinal > query.inserted_after)
    if query.cursor is not None:
        here = tuple_(p.t1_ns, p.ordinal)
        place = read_cursor(query.cursor, query.oldest_first)
        found.append(here > place if query.oldest_first else here < place)
    return found


def _page(query: Query, found: list[ProductRecord], unplaced: tuple[str, ...]) -> Page:
    items = tuple(found[: query.limit])
    more = len(found) > query.limit
    cursor = make_cursor(query.oldest_first, items[-1].header.t1_ns, items[-1].ordinal) if more else None
    return Page(items, cursor, unplaced)


def _inside(
    rows: Sequence[Any], region: Region, transforms: dict[str, tuple[int, UncertainTransform]]
) -> list[ProductRecord]:
    keep = np.zeros(len(rows), dtype=bool)
    for name in {row.frame for row in rows}:
        of_frame = np.array([i for i, row in enumerate(rows) if row.frame == name])
        boxes = np.array([[getattr(rows[i], side) for side in _SIDES] for i in of_frame])
        keep[of_frame] = touches(region, boxes, transforms[name][1].matrix)
    return [record_of(row) for row, kept in zip(rows, keep, strict=True) if kept]


def touches(region: Region, boxes_m: NDArray[np.float64], T_region_boxes: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Tell which boxes ``(n, 6)`` touch the region: outline in the plane, and height where the region has one.

    The outline of a box that is turned against the region's axes is the convex hull of its corners.
    """
    corners = _corners(boxes_m) @ T_region_boxes[:3, :3].T + T_region_boxes[:3, 3]
    low, high = corners.min(axis=1), corners.max(axis=1)
    x0, y0, z0, x1, y1, z1 = region.box_m
    near = (low[:, 0] <= x1) & (high[:, 0] >= x0) & (low[:, 1] <= y1) & (high[:, 1] >= y0)
    near &= (low[:, 2] <= z1) & (high[:, 2] >= z0)
    upright = np.array_equal(np.abs(T_region_boxes[:3, :3]).round(12), np.eye(3))
    if upright and region.kind in ("bbox", "box"):
        return np.asarray(near)
    if upright and region.kind == "circle":
        cx, cy, r = region.values
        dx = np.maximum(np.maximum(low[:, 0] - cx, cx - high[:, 0]), 0.0)
        dy = np.maximum(np.maximum(low[:, 1] - cy, cy - high[:, 1]), 0.0)
        return np.asarray(near & (np.hypot(dx, dy) <= r))
    indices = np.flatnonzero(near)
    if len(indices):
        near[indices] = _outlines_touch(region, corners[indices, :, :2])
    return np.asarray(near)


def _outlines_touch(region: Region, corners_xy: NDArray[np.float64]) -> NDArray[np.bool_]:
    import shapely

    n = len(corners_xy)
    hulls = shapely.convex_hull(
        shapely.multipoints(corners_xy.reshape(-1, 2), indices=np.repeat(np.arange(n), corners_xy.shape[1]))
    )
    if region.kind == "circle":
        cx, cy, r = region.values
        return np.asarray(shapely.distance(hulls, shapely.Point(cx, cy)) <= r, dtype=np.bool_)
    x0, y0, x1, y1 = region.bounds
    polygon = region.kind == "polygon"
    outline = shapely.Polygon(np.array(region.values).reshape(-1, 2)) if polygon else shapely.box(x0, y0, x1, y1)
    return np.asarray(shapely.intersects(hulls, outline), dtype=np.bool_)


def _corners(boxes_m: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(_CORNERS[None], boxes_m[:, None, 3:], boxes_m[:, None, :3])


def _free_height_bounds(
    box: tuple[float, ...], matrix: NDArray[np.float64], heights: tuple[float, float]
) -> tuple[float, ...]:
    """Bounds in the frame of all points with query xy inside ``box`` and frame z within ``heights``.

    ``x_q = R x_f + t`` restricted to its first two rows is solved for ``(x_f, y_f)`` at each corner of the box and each
    end of the heights; a frame that lies on its side against the query's plane leaves x and y free.
    """
    A = matrix[:2, :2]
    if abs(float(np.linalg.det(A))) < 1e-6:
        return (-math.inf, -math.inf, heights[0], math.inf, math.inf, heights[1])
    corners = np.array([[x, y] for x in (box[0], box[3]) for y in (box[1], box[4])])
    solved = np.concatenate([np.linalg.solve(A, (corners - matrix[:2, 3] - matrix[:2, 2] * z).T).T for z in heights])
    (xmin, ymin), (xmax, ymax) = solved.min(axis=0), solved.max(axis=0)
    slack = _SLACK * (1.0 + max(abs(v) for v in (xmin, ymin, xmax, ymax)))
    return (xmin - slack, ymin - slack, heights[0], xmax + slack, ymax + slack, heights[1])

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Footprints: the outline of what a product covers, in the x-y plane of its frame.

A footprint holds all of the data and fills holes and gaps between its parts, so that a search that it refines loses
nothing. It is stored where the header gives one, or where the decoded value is there and covers clearly less than its
box.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sqlalchemy import Connection, select

from cdff_common.interfaces.product import Header
from dpm_store import schema, sqlite

FloatArray = NDArray[np.float64]
#: Cells along the longer side that an outline is drawn on.
_CELLS = 48
#: Of a ring that is drawn; with more it becomes its hull.
_MAX_DRAWN = 256
#: A footprint that covers more of the box than this says no more than the box.
_FULL = 0.95
_BATCH = 500


def footprint_of(header: Header, value: Any) -> FloatArray | None:
    """Outline ``(k, 2)`` in metres, not closed; None where the box says as much, or nothing is known.

    Parameters
    ----------
    value : Any
        The decoded payload, or None: maps (observed cells) and clouds (points) have an outline.
    """
    if header.footprint_m is not None:
        return np.array(header.footprint_m).reshape(-1, 2)
    drawn = None
    if value is not None and hasattr(value, "geometry") and hasattr(value, "layer_names"):
        drawn = _of_map(value)
    elif value is not None and hasattr(value, "points_m"):
        drawn = _of_points(np.asarray(value.points_m, dtype=np.float64)[:, :2])
    if drawn is None:
        return None
    occupied, left, top, cell_w, cell_h = drawn
    if occupied.mean() > _FULL:
        return None
    return outline(occupied, left, top, cell_w, cell_h)


def ring_bytes(ring: FloatArray) -> bytes:
    """A ring as a column."""
    return np.ascontiguousarray(ring, dtype="<f8").tobytes()


def ring_from(data: bytes) -> FloatArray:
    """Inverse of ``ring_bytes``."""
    return np.frombuffer(data, "<f8").reshape(-1, 2)


def rings_in(connection: Connection, ordinals: Iterable[int]) -> dict[int, FloatArray]:
    """Rings of the products that have one."""
    return {ordinal: ring_from(ring) for ordinal, ring in sqlite.rings(connection, ordinals)}


def footprints(connection: Connection, ids: Iterable[str]) -> dict[str, FloatArray]:
    """Outlines of products by id: the footprint, else the box's outline; without those that have neither.

    Rings ``(k, 2)``, metres in the product's frame, not closed.
    """
    p, wanted = schema.products.c, list(ids)
    found: dict[str, FloatArray] = {}
    for i in range(0, len(wanted), _BATCH):
        statement = select(p.id, p.ordinal, p.xmin_m, p.ymin_m, p.xmax_m, p.ymax_m).where(
            p.id.in_(wanted[i : i + _BATCH]), p.xmin_m.is_not(None)
        )
        rows = connection.execute(statement).all()
        rings = rings_in(connection, [row.ordinal for row in rows])
        for row in rows:
            x0, y0, x1, y1 = row[2:6]
            found[row.id] = rings.get(row.ordinal, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
    return found


def outline(occupied: NDArray[np.bool_], left: float, top: float, cell_w: float, cell_h: float) -> FloatArray:
    """Ring around the occupied cells ``(rows, cols)``, row 0 at the top; all of them inside, gaps closed."""
    import shapely

    x0, y0, x1, y1 = [], [], [], []
    for row in np.flatnonzero(occupied.any(axis=1)):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], occupied[row].view(np.int8), [0]])))
        for begin, end in edges.reshape(-1, 2):
            x0.append(left + begin * cell_w)
            x1.append(left + end * cell_w)
            y0.append(top - (row + 1) * cell_h)
            y1.append(top - row * cell_h)
    whole = shapely.union_all(shapely.box(x0, y0, x1, y1))
    reach = max(cell_w, cell_h)
    while whole.geom_type != "Polygon" and reach < 64 * max(cell_w, cell_h):
        whole = shapely.union_all([whole, whole.buffer(reach, join_style="bevel").buffer(-reach, join_style="bevel")])
        reach *= 2.0
    if whole.geom_type != "Polygon" or len(whole.exterior.coords) > _MAX_DRAWN:
        whole = shapely.convex_hull(whole)
    return np.array(whole.exterior.coords)[:-1]


def _of_map(value: Any) -> tuple[NDArray[np.bool_], float, float, float, float] | None:
    grid = value.geometry
    if "mean" in value.layer_names:
        observed = np.isfinite(value.layer("mean"))
    elif "class" in value.layer_names:
        observed = value.layer("class") != 0
    else:
        return None
    if not observed.any():
        return None
    factor = -(-max(grid.rows, grid.cols) // _CELLS)
    rows, cols = -(-grid.rows // factor), -(-grid.cols // factor)
    padded = np.zeros((rows * factor, cols * factor), dtype=bool)
    padded[: grid.rows, : grid.cols] = observed
    coarse = np.asarray(padded.reshape(rows, factor, cols, factor).any(axis=(1, 3)))
    size = grid.resolution_m * factor
    return coarse, grid.xmin_m, grid.ymax_m, size, size


def _of_points(xy: FloatArray) -> tuple[NDArray[np.bool_], float, float, float, float] | None:
    xy = xy[np.isfinite(xy).all(axis=1)]
    if len(xy) < 3:
        return None
    low, high = xy.min(axis=0), xy.max(axis=0)
    if not (high > low).all():
        return None
    cell_w, cell_h = (high - low) / _CELLS
    columns, rows = np.minimum(((xy - low) / (high - low) * _CELLS).astype(np.int64), _CELLS - 1).T
    occupied = np.zeros((_CELLS, _CELLS), dtype=bool)
    occupied[_CELLS - 1 - rows, columns] = True
    return occupied, float(low[0]), float(high[1]), float(cell_w), float(cell_h)

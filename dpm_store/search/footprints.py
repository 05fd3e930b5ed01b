# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Footprints: outlines of the data of products in the x-y plane of their frame.

A footprint contains all of the data and closes holes and gaps, so that it never excludes a product wrongly.
It is stored if the header has one, or if the decoded value covers clearly less than its box.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import cache
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from sqlalchemy import Connection, Select, select

from cdff_common.interfaces.product import Header
from dpm_store.engine import schema
from dpm_store.engine.database import DIALECTS, Database, dialect_of

FloatArray = NDArray[np.float64]
#: Cells of the grid of an outline along its longer side.
_CELLS = 48
#: Radii in cells, by which gaps between occupied cells are closed until these are connected.
_CLOSING_RADII = (1, 2, 4, 8)
#: Corners of an outline; with more it is replaced by its hull.
_MAX_CORNERS = 256
#: Largest fraction of the box that a footprint covers; above it the box is used.
_FULL = 0.95


def footprint_of(header: Header, value: Any) -> FloatArray | None:
    """Return the outline ``(k, 2)`` in metres, not closed; None if the box is nearly equal, or there are no
    data.

    Parameters
    ----------
    value : Any
        Decoded payload or None: maps (observed cells) and clouds (points) have an outline.
    """
    if header.footprint_m is not None:
        return np.array(header.footprint_m).reshape(-1, 2)
    grid = None
    if hasattr(value, "layer_names"):
        grid = _of_map(value)
    elif hasattr(value, "points_m"):
        grid = _of_points(np.asarray(value.points_m, dtype=np.float64)[:, :2])
    if grid is None:
        return None
    occupied, left, top, cell_w, cell_h = grid
    if occupied.mean() > _FULL:
        return None
    return outline(occupied, left, top, cell_w, cell_h)


def ring_bytes(ring: FloatArray) -> bytes:
    """Return a ring as a column."""
    return np.ascontiguousarray(ring, dtype="<f8").tobytes()


def ring_from(data: bytes) -> FloatArray:
    """Return the ring of a column."""
    return np.frombuffer(data, "<f8").reshape(-1, 2)


def rings_in(connection: Connection, ordinals: Iterable[int]) -> dict[int, FloatArray]:
    """Return the rings of products by ordinal, for those that have one."""
    rows = dialect_of(connection).fetch(connection, *rings_statement(connection, ordinals))
    return rings_of(rows)


def rings_statement(connection: Connection, ordinals: Iterable[int]) -> tuple[Select[Any], dict[str, Any]]:
    """Return the statement of ``rings_in`` and its values."""
    listed = dialect_of(connection).list_value(list(ordinals))
    return _rings(connection.dialect.name), {"ordinals": listed}


def rings_of(rows: Iterable[Sequence[Any]]) -> dict[int, FloatArray]:
    """Return the rings in the rows of ``rings_statement``, by ordinal."""
    return {ordinal: ring_from(ring) for ordinal, ring in rows}


def footprints(database: Database, ids: Iterable[str]) -> dict[str, FloatArray]:
    """Return the outlines of products by id: the footprint, or else the outline of the box; none without
    either.

    Rings ``(k, 2)``, metres in the product's frame, not closed.
    """
    p, dialect = schema.products.c, database.dialect
    statement = select(p.id, p.ordinal, p.xmin_m, p.ymin_m, p.xmax_m, p.ymax_m).where(
        p.id.in_(dialect.elements("ids")), p.xmin_m.is_not(None)
    )
    with database.read() as connection:
        rows = connection.execute(statement, {"ids": dialect.list_value(list(ids))}).all()
        rings = rings_in(connection, [row.ordinal for row in rows])
    return {
        row.id: rings.get(row.ordinal, np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]]))
        for row in rows
        for x0, y0, x1, y1 in (row[2:6],)
    }


def outline(
    occupied: NDArray[np.bool_], xmin_m: float, ymax_m: float, cell_width_m: float, cell_height_m: float
) -> FloatArray:
    """Return a ring ``(k, 2)``, metres, not closed, around all occupied cells ``(rows, cols)``, gaps filled.

    Row 0 is at the top; ``xmin_m`` and ``ymax_m`` are the outer corner of the first cell.
    """
    import shapely

    def polygon_of(occupied: NDArray[np.bool_]) -> Any:
        change = np.diff(np.pad(occupied, ((0, 0), (1, 1))).astype(np.int8))
        (row, start), (_, end) = np.nonzero(change == 1), np.nonzero(change == -1)
        boxes = shapely.box(
            xmin_m + start * cell_width_m,
            ymax_m - (row + 1) * cell_height_m,
            xmin_m + end * cell_width_m,
            ymax_m - row * cell_height_m,
        )
        return shapely.union_all(boxes)

    shape = polygon_of(occupied)
    for radius in _CLOSING_RADII:
        if shape.geom_type == "Polygon":
            break
        occupied = _closed(occupied, radius)
        shape = polygon_of(occupied)
    if shape.geom_type != "Polygon" or len(shape.exterior.coords) > _MAX_CORNERS:
        shape = shapely.convex_hull(shape)
    return np.array(shape.exterior.coords)[:-1]


def _closed(occupied: NDArray[np.bool_], radius: int) -> NDArray[np.bool_]:
    """Return the closing by a square of ``2 radius + 1`` cells; it contains every occupied cell."""
    closed = np.pad(occupied, 2 * radius)
    for reduce in (np.any, np.all):  # dilation, then erosion
        for axis in (0, 1):
            closed = reduce(sliding_window_view(closed, 2 * radius + 1, axis=axis), axis=-1)
    return closed


@cache
def _rings(dialect_name: str) -> Select[Any]:
    f, dialect = schema.footprints.c, DIALECTS[dialect_name]
    return select(f.ordinal, f.ring).where(f.ordinal.in_(dialect.elements("ordinals", int)))


def _of_map(value: Any) -> tuple[NDArray[np.bool_], float, float, float, float] | None:
    """Return the observed cells, coarsened, with x and y of the first corner and the cell sizes; None
    without cells.
    """
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
    """Return the occupied cells of points, with x and y of the first corner and the cell sizes; None without
    an area.
    """
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

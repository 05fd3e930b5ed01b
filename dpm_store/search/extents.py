# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Extents of the products of each type and frame, for catalogues."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sqlalchemy import func, select

from cdff_common.clock import monotonic_s
from dpm_store.engine import schema
from dpm_store.engine.database import Database

if TYPE_CHECKING:
    from dpm_store.store import Store

#: Minimum interval between readings, in durations of a reading.
_PAUSE = 20.0


@dataclass(frozen=True, slots=True)
class Extent:
    """Extent of the products of one type in one frame.

    Attributes
    ----------
    product, frame : str
    box_m : tuple of 6 floats or None
        ``xmin ymin zmin xmax ymax zmax`` in the frame; None if no product has a box.
    t0_ns, t1_ns : int
        First start and last end of capture.
    count : int
    resolution_m : float or None
        Smallest cell or voxel; None if no product has one.
    """

    product: str
    frame: str
    box_m: tuple[float, float, float, float, float, float] | None
    t0_ns: int
    t1_ns: int
    count: int
    resolution_m: float | None = None


@dataclass(frozen=True, slots=True)
class Origin:
    """Products of one type, robot, DFPC, port, ASN.1 type and status.

    Attributes
    ----------
    finest_m, coarsest_m : float or None
        Smallest and largest cell or voxel; None if no product has one.
    """

    product: str
    robot: str
    dfpc: str
    port: str
    type_name: str
    status: str
    finest_m: float | None
    coarsest_m: float | None
    count: int


def origins(database: Database) -> tuple[Origin, ...]:
    """Return the origins of live products; reads every row."""
    p = schema.products.c
    key = (p.product, p.robot, p.dfpc, p.port, p.type_name, p.status)
    values = (func.min(p.resolution_m), func.max(p.resolution_m), func.count())
    statement = select(*key, *values).where(p.deleted_ns.is_(None)).group_by(*key).order_by(*key)
    with database.read() as connection:
        return tuple(Origin(*row) for row in connection.execute(statement))


def extents(database: Database) -> tuple[Extent, ...]:
    """Return the extents of live products; reads every row."""
    p = schema.products.c
    lows = [func.min(c) for c in (p.xmin_m, p.ymin_m, p.zmin_m)]
    highs = [func.max(c) for c in (p.xmax_m, p.ymax_m, p.zmax_m)]
    statement = (
        select(
            p.product,
            p.frame,
            *lows,
            *highs,
            func.min(p.t0_ns),
            func.max(p.t1_ns),
            func.count(),
            func.min(p.resolution_m),
        )
        .where(p.deleted_ns.is_(None))
        .group_by(p.product, p.frame)
        .order_by(p.product, p.frame)
    )
    with database.read() as connection:
        rows = connection.execute(statement).all()
    return tuple(
        Extent(product, frame, None if values[0] is None else tuple(values[:6]), *values[6:])  # 6: the box
        for product, frame, *values in rows
    )


def frame_names(database: Database) -> tuple[str, ...]:
    """Return the frames that have held products."""
    with database.read() as connection:
        return tuple(connection.execute(select(schema.frame_names.c.frame)).scalars())


class ExtentCache:
    """Cache of extents; they are read again after changes, for at most a twentieth of the time."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._extents: tuple[Extent, ...] = ()
        self._origins: tuple[Origin, ...] = ()
        self._ordinal = -1
        self._valid_until_s = 0.0

    def get(self, store: Store) -> tuple[Extent, ...]:
        """Return the extents of a store."""
        with self._lock:
            self._update(store)
            return self._extents

    def origins(self, store: Store) -> tuple[Origin, ...]:
        """Return the origins of a store."""
        with self._lock:
            self._update(store)
            return self._origins

    def _update(self, store: Store) -> None:
        ordinal, started_s = store.events.last_ordinal(), monotonic_s()
        if ordinal != self._ordinal and started_s >= self._valid_until_s:
            self._extents, self._origins, self._ordinal = store.extents(), store.origins(), ordinal
            end_s = monotonic_s()
            self._valid_until_s = end_s + _PAUSE * (end_s - started_s)

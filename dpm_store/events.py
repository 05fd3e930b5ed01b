# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The append-only history of what happened: insertions, activations, re-anchorings, alarms."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import msgpack
from sqlalchemy import Connection, func, insert, select

from cdff_common.clock import Clock
from cdff_common.errors import InputError
from dpm_store import schema
from dpm_store.database import Database

#: Kinds that say that what the store holds has changed; the others are history only.
CHANGES = ("inserted", "updated", "deleted", "reanchored")
_MAX_BODY_BYTES = 1 << 16


@dataclass(frozen=True, slots=True)
class Event:
    """Something that happened.

    Attributes
    ----------
    ordinal : int
        Grows by one or more with each event.
    stamp_ns : int
        Mission time.
    scope : str
        Robot id or ``ground``.
    kind : str
        inserted, deleted, activated, deactivated, reanchored, alarm, …
    body : mapping
        Plain data.
    """

    ordinal: int
    stamp_ns: int
    scope: str
    kind: str
    body: Mapping[str, Any]


class EventTable:
    """Events, never changed and never deleted."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def append(self, scope: str, kind: str, body: Mapping[str, Any], stamp_ns: int | None = None) -> Event:
        """Add an event; raises InputError for a body that is no plain data or over 64 kB."""
        with self._database.write() as connection:
            return self.append_in(connection, scope, kind, body, stamp_ns)

    def append_in(
        self, connection: Connection, scope: str, kind: str, body: Mapping[str, Any], stamp_ns: int | None = None
    ) -> Event:
        """As ``append``, inside a transaction."""
        try:
            packed = msgpack.packb(dict(body))
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"event {kind}: body is not plain data: {error}") from error
        if len(packed) > _MAX_BODY_BYTES:
            raise InputError(f"event {kind}: body of {len(packed)} bytes, expected at most {_MAX_BODY_BYTES}")
        stamp = self._clock.now_ns() if stamp_ns is None else stamp_ns
        row = {"stamp_ns": stamp, "scope": scope, "kind": kind, "body": packed}
        ordinal: int = connection.execute(insert(schema.events).returning(schema.events.c.ordinal), row).scalar_one()
        return Event(ordinal, stamp, scope, kind, dict(body))

    def since(
        self, ordinal: int = 0, *, kind: str | Sequence[str] | None = None, limit: int = 1000
    ) -> tuple[Event, ...]:
        """Events after an ordinal, in order; of one kind or of several where asked."""
        e = schema.events.c
        statement = select(schema.events).where(e.ordinal > ordinal)
        if kind is not None:
            statement = statement.where(e.kind.in_([kind] if isinstance(kind, str) else list(kind)))
        with self._database.read() as connection:
            rows = connection.execute(statement.order_by(e.ordinal).limit(limit)).all()
        return tuple(Event(r.ordinal, r.stamp_ns, r.scope, r.kind, msgpack.unpackb(r.body)) for r in rows)

    def last_ordinal(self) -> int:
        """Ordinal of the newest event, 0 without any."""
        with self._database.read() as connection:
            return connection.execute(select(func.max(schema.events.c.ordinal))).scalar_one() or 0

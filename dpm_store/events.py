# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The append-only history of what happened: insertions, activations, re-anchorings, alarms."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import msgpack
from sqlalchemy import Connection, func, insert, select, update

from cdff_common.clock import Clock
from cdff_common.errors import InputError
from dpm_store import schema, sqlite
from dpm_store.actor import actor
from dpm_store.database import Database

#: Kinds that say that what the store holds has changed; the others are history only.
CHANGES = ("inserted", "updated", "deleted", "reanchored")
_MAX_BODY_BYTES = 1 << 16
_ORIGIN = re.compile(r"[a-z0-9_/]{1,40}")
_NAME = re.compile(r"[a-z0-9_]{1,64}")


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


@dataclass(frozen=True, slots=True)
class Entry:
    """A line of another service's journal.

    Attributes
    ----------
    number : int
        Of the line in that journal, from 1, growing.
    stamp_ns : int
        Mission time.
    scope, kind : str
        As of ``Event``.
    body : mapping
        Plain data.
    """

    number: int
    stamp_ns: int
    scope: str
    kind: str
    body: Mapping[str, Any]


def signed(body: Mapping[str, Any]) -> dict[str, Any]:
    """A body with who acts in it: every change is its own audit entry."""
    who = actor()
    return dict(body) if who is None else {**body, "by": who.text}


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
        """As ``append``, inside a transaction; ``by`` in the body is who acts."""
        stamp = self._clock.now_ns() if stamp_ns is None else stamp_ns
        row = _row(scope, kind, signed(body), stamp)
        ordinal: int = connection.execute(insert(schema.events).returning(schema.events.c.ordinal), row).scalar_one()
        return Event(ordinal, stamp, scope, kind, signed(body))

    def append_all_in(self, connection: Connection, kind: str, bodies: Sequence[tuple[str, Mapping[str, Any]]]) -> None:
        """Add events of one kind, each with its scope, inside a transaction."""
        stamp = self._clock.now_ns()
        sqlite.insert_rows(
            connection, schema.events, [_row(scope, kind, signed(body), stamp) for scope, body in bodies]
        )

    def append_from(self, origin: str, entries: Sequence[Entry]) -> int:
        """Add the entries of another service's journal, each once however often it is sent.

        Parameters
        ----------
        origin : str
            Whose journal: lower case letters, digits, ``_``, ``/``, at most 40.
        entries : sequence of Entry
            Their numbers grow.

        Returns
        -------
        int
            Number of the last entry that is kept; all up to it are.

        Raises
        ------
        InputError
            If a name, a number or a body cannot be kept: nothing of the call is.
        """
        if not _ORIGIN.fullmatch(origin):
            raise InputError(f"origin {origin[:60]!r}: expected lower case letters, digits, _ and /, at most 40")
        key, numbers = f"history:{origin}", [entry.number for entry in entries]
        if any(b <= a for a, b in pairwise(numbers)):
            raise InputError(f"history of {origin}: numbers {numbers[:3]}… do not grow")
        m = schema.meta.c
        with self._database.write() as connection:
            kept = connection.execute(select(m.value).where(m.name == key)).scalar_one_or_none()
            last = int(kept or 0)
            for entry in entries:
                if entry.number > last:
                    body = {**entry.body, "origin": origin, "number": entry.number}
                    self.append_in(connection, entry.scope, entry.kind, body, entry.stamp_ns)
                    last = entry.number
            if kept is None:
                connection.execute(insert(schema.meta), {"name": key, "value": str(last)})
            else:
                connection.execute(update(schema.meta).where(m.name == key).values(value=str(last)))
        return last

    def since(
        self, ordinal: int = 0, *, kind: str | Sequence[str] | None = None, scope: str | None = None, limit: int = 1000
    ) -> tuple[Event, ...]:
        """Events after an ordinal, in order; of one kind or of several, and of one scope, where asked."""
        e = schema.events.c
        statement = select(schema.events).where(e.ordinal > ordinal)
        if kind is not None:
            statement = statement.where(e.kind.in_([kind] if isinstance(kind, str) else list(kind)))
        if scope is not None:
            statement = statement.where(e.scope == scope)
        with self._database.read() as connection:
            rows = connection.execute(statement.order_by(e.ordinal).limit(limit)).all()
        return tuple(Event(r.ordinal, r.stamp_ns, r.scope, r.kind, msgpack.unpackb(r.body)) for r in rows)

    def last_ordinal(self) -> int:
        """Ordinal of the newest event, 0 without any."""
        with self._database.read() as connection:
            return connection.execute(select(func.max(schema.events.c.ordinal))).scalar_one() or 0


def _row(scope: str, kind: str, body: Mapping[str, Any], stamp_ns: int) -> dict[str, Any]:
    if not (_NAME.fullmatch(scope) and _NAME.fullmatch(kind)):
        raise InputError(f"event {kind[:64]!r} of {scope[:64]!r}: expected lower case letters, digits and _")
    try:
        packed = msgpack.packb(dict(body))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"event {kind}: body is not plain data: {error}") from error
    if len(packed) > _MAX_BODY_BYTES:
        raise InputError(f"event {kind}: body of {len(packed)} bytes, expected at most {_MAX_BODY_BYTES}")
    return {"stamp_ns": stamp_ns, "scope": scope, "kind": kind, "body": packed}

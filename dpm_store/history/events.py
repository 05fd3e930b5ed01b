# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The append-only history of events (insertions, activations, re-anchorings, alarms) and their actors."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import msgpack
from sqlalchemy import Connection, bindparam, func, insert, select

from cdff_common.clock import Clock
from cdff_common.errors import DeniedError, InputError
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of

#: Kinds of changes of the products and frames; the other kinds are history only.
CHANGES = ("inserted", "updated", "deleted", "reanchored")
#: Roles of actors from weak to strong, except that a robot writes only its own products.
ROLES = ("reader", "robot", "operator", "admin")
#: Largest size of the body of an event.
_MAX_BODY_BYTES = 1 << 16
_e = schema.events.c
_SINCE = (
    select(_e.ordinal, _e.stamp_ns, _e.scope, _e.kind, _e.body)
    .where(_e.ordinal > bindparam("after"))
    .order_by(_e.ordinal)
    .limit(bindparam("limit"))
)
_ORIGIN = re.compile(r"[a-z0-9_/]{1,40}")
_NAME = re.compile(r"[a-z0-9_]{1,64}")


@dataclass(frozen=True, slots=True)
class Actor:
    """The user or service that makes changes; recorded with every change in the history.

    Attributes
    ----------
    name : str
        Name of the key; the id of a robot.
    role : str
        One of ``ROLES``.
    via : str
        ``http`` or ``zenoh``.
    """

    name: str
    role: str
    via: str

    @property
    def text(self) -> str:
        """Form in the history: ``via/role/name``."""
        return f"{self.via}/{self.role}/{self.name}"

    def check_robot(self, robot: str) -> None:
        """Raise DeniedError if the actor is another robot."""
        if self.role == "robot" and robot != self.name:
            raise DeniedError(
                f"robot {self.name[:64]} may write only its own products, these are of {robot[:64]!r}"
            )


_ACTOR: ContextVar[Actor | None] = ContextVar("actor", default=None)


@contextmanager
def acting(actor: Actor | None) -> Iterator[None]:
    """Attribute all changes inside the block to an actor."""
    token = _ACTOR.set(actor)
    try:
        yield
    finally:
        _ACTOR.reset(token)


def actor() -> Actor | None:
    """Return the current actor; None for the process itself."""
    return _ACTOR.get()


def check_robot(robot: str) -> None:
    """Raise DeniedError if the current actor is another robot."""
    if (present := actor()) is not None:
        present.check_robot(robot)


@dataclass(frozen=True, slots=True)
class Event:
    """An entry of the history.

    Attributes
    ----------
    ordinal : int
        Increases with each event.
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

    def to_dict(self) -> dict[str, Any]:
        """Return the fields of the body with ``ordinal``, ``stamp_ns``, ``scope`` and ``kind``.

        A field of the body that has one of these names and another value is returned as ``body_{name}``.
        """
        own = {"ordinal": self.ordinal, "stamp_ns": self.stamp_ns, "scope": self.scope, "kind": self.kind}
        renamed = {
            f"body_{name}" if own.get(name, value) != value else name: value
            for name, value in self.body.items()
        }
        return {**renamed, **own}


def _with_actor(body: Mapping[str, Any]) -> dict[str, Any]:
    """Return a body with the present actor: every change is its own audit entry."""
    present = actor()
    return dict(body) if present is None else {**body, "by": present.text}


class EventTable:
    """Events, never changed and never deleted."""

    def __init__(self, database: Database, clock: Clock) -> None:
        self._database = database
        self._clock = clock

    def append(
        self,
        scope: str,
        kind: str,
        body: Mapping[str, Any],
        stamp_ns: int | None = None,
        *,
        connection: Connection | None = None,
    ) -> Event:
        """Append an event; raises InputError for a body that is not plain data or over 64 kB."""
        with self._database.write(connection) as connection:
            stamp = self._clock.now_ns() if stamp_ns is None else stamp_ns
            row = _row(scope, kind, _with_actor(body), stamp)
            ordinal: int = connection.execute(
                insert(schema.events).returning(schema.events.c.ordinal), row
            ).scalar_one()
            return Event(ordinal, stamp, scope, kind, _with_actor(body))

    def append_all_in(
        self, connection: Connection, kind: str, bodies: Sequence[tuple[str, Mapping[str, Any]]]
    ) -> None:
        """Append events of one kind, each with its scope, inside a transaction."""
        stamp = self._clock.now_ns()
        rows = [_row(scope, kind, _with_actor(body), stamp) for scope, body in bodies]
        dialect_of(connection).insert_rows(connection, schema.events, rows)

    def append_from(self, origin: str, entries: Sequence[Event]) -> int:
        """Append the entries of another service's journal; entries that were appended before are skipped.

        Parameters
        ----------
        origin : str
            Name of the journal: lower case letters, digits, ``_``, ``/``, at most 40.
        entries : sequence of Event
            By increasing ordinal, which is the number in that journal, from 1.

        Returns
        -------
        int
            Number of the last entry that is stored; all up to it are.

        Raises
        ------
        InputError
            If a name, a number or a body is invalid: nothing is appended.
        """
        if not _ORIGIN.fullmatch(origin):
            raise InputError(
                f"origin {origin[:60]!r}: expected lower case letters, digits, _ and /, at most 40"
            )
        key, numbers = f"history:{origin}", [entry.ordinal for entry in entries]
        if any(b <= a for a, b in pairwise(numbers)):
            raise InputError(f"history of {origin}: numbers {numbers[:3]}… do not increase")
        m = schema.meta.c
        with self._database.write() as connection:
            last = int(connection.execute(select(m.value).where(m.name == key)).scalar() or 0)
            rows = [
                _row(
                    entry.scope,
                    entry.kind,
                    _with_actor({**entry.body, "origin": origin, "number": entry.ordinal}),
                    entry.stamp_ns,
                )
                for entry in entries
                if entry.ordinal > last
            ]
            dialect_of(connection).insert_rows(connection, schema.events, rows)
            last = max([last, *numbers])
            value = {"name": key, "value": str(last)}
            dialect_of(connection).upsert_rows(connection, schema.meta, [value], replace=("value",))
        return last

    def since(
        self,
        ordinal: int = 0,
        *,
        kind: str | Sequence[str] | None = None,
        scope: str | None = None,
        limit: int = 1000,
    ) -> tuple[Event, ...]:
        """Return the events after an ordinal, in order, optionally of some kinds and of one scope."""
        e = schema.events.c
        if kind is None and scope is None:
            with self._database.read() as connection:
                values = {"after": ordinal, "limit": limit}
                event_rows = dialect_of(connection).fetch(connection, _SINCE, values)
            return tuple(Event(o, stamp, s, k, msgpack.unpackb(body)) for o, stamp, s, k, body in event_rows)
        statement = select(schema.events).where(e.ordinal > ordinal)
        if kind is not None:
            statement = statement.where(e.kind.in_([kind] if isinstance(kind, str) else list(kind)))
        if scope is not None:
            statement = statement.where(e.scope == scope)
        with self._database.read() as connection:
            rows = connection.execute(statement.order_by(e.ordinal).limit(limit)).all()
        return tuple(Event(r.ordinal, r.stamp_ns, r.scope, r.kind, msgpack.unpackb(r.body)) for r in rows)

    def last_ordinal(self) -> int:
        """Return the ordinal of the newest event, 0 if there is none."""
        with self._database.read() as connection:
            return connection.execute(select(func.max(schema.events.c.ordinal))).scalar_one() or 0


def _row(scope: str, kind: str, body: Mapping[str, Any], stamp_ns: int) -> dict[str, Any]:
    """Return the row of an event; raises InputError for bad names or a body that is too large or not plain
    data.
    """
    if not (_NAME.fullmatch(scope) and _NAME.fullmatch(kind)):
        raise InputError(f"event {kind[:64]!r} of {scope[:64]!r}: expected lower case letters, digits and _")
    try:
        packed = msgpack.packb(dict(body))
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"event {kind}: body is not plain data: {error}") from error
    if len(packed) > _MAX_BODY_BYTES:
        raise InputError(f"event {kind}: body of {len(packed)} bytes, expected at most {_MAX_BODY_BYTES}")
    return {"stamp_ns": stamp_ns, "scope": scope, "kind": kind, "body": packed}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recording of committed changes, and comparison of the records with the database."""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import msgpack
from sqlalchemy import Connection, Table, bindparam, func, select

from cdff_common.output import replace_file
from dpm_store.changes.change_files import ChangeFiles
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of
from dpm_store.history.unnamed import unnamed_payloads
from dpm_store.payloads.payloads import Payloads

logger = logging.getLogger(__name__)

FOLDER = "changes"
_LOST = "lost.json"
#: Changes of one transaction; a batch of products has fewer.
MAX_CHANGES = 1 << 20
#: Changes of earlier transactions that are recorded at once.
_PAGE = 1000

_e, _p, _b = schema.events.c, schema.products.c, schema.blobs.c
_EVENTS = (
    select(_e.ordinal, _e.stamp_ns, _e.scope, _e.kind, _e.body)
    .where(_e.ordinal > bindparam("last"))
    .order_by(_e.ordinal)
    .limit(bindparam("limit"))
)


class Change(NamedTuple):
    """An event and, for some kinds, the row that it added.

    Attributes
    ----------
    ordinal, stamp_ns, scope, kind
        Columns of ``events``.
    body : bytes
        The body of the event as MessagePack.
    row : list or None
        Of an inserted product: type, codec, header, size, time of insertion, chunk sums, location in the
        packs, outline. Of an update, a frame or a body: the row of its table.
    """

    ordinal: int
    stamp_ns: int
    scope: str
    kind: str
    body: bytes
    row: list[Any] | None = None

    @property
    def fields(self) -> dict[str, Any]:
        """The body of the event."""
        fields: dict[str, Any] = msgpack.unpackb(self.body)
        return fields

    @classmethod
    def parse(cls, record: bytes) -> Change:
        """Return the change in a record."""
        return cls._make(msgpack.unpackb(record))


class ChangeRecorder:
    """Appends a record for every committed event.

    Parameters
    ----------
    directory : Path
        Directory of the store.

    payloads : Payloads
        Compared with the database if there are no records yet.
    """

    def __init__(self, directory: Path, database: Database, payloads: Payloads) -> None:
        self._database = database
        self._folder = directory / FOLDER
        is_first = not self._folder.exists()
        self.files = ChangeFiles(self._folder)
        self._is_failing = False
        self._note = self._read_note()
        self._last = self._last_common()
        if is_first and (unnamed := unnamed_payloads(database, payloads)).is_most:
            self._write_note(f"{unnamed}, which is most of them", changes=self._note["changes"])
        with database.read() as connection:
            while not self._is_failing and (changes := self.unrecorded(connection, _PAGE)):
                self.record(changes)
        database.observer = self

    def unrecorded(self, connection: Connection, limit: int = MAX_CHANGES) -> list[Change]:
        """Return the changes of an open transaction that are not recorded."""
        return changes_after(connection, self._last, limit)

    def record(self, changes: Sequence[Change]) -> None:
        """Record committed changes; a failure of the disk is logged, and the next call tries again."""
        if not changes:
            return
        try:
            self.files.append([msgpack.packb(change) for change in changes])
        except OSError as error:
            if not self._is_failing:
                logger.warning("changes are not recorded outside the database: %s", error)
            self._is_failing = True
            return
        self._is_failing = False
        self._last = changes[-1].ordinal

    def close(self) -> None:
        """Make the records durable."""
        with suppress(OSError):  # they are written again from the database
            self.files.close()

    @property
    def loss(self) -> str:
        """Reason why the database is known to be damaged or replaced, until it is rebuilt; else empty."""
        if not self._note["reason"]:
            return ""
        return (
            f"{self._note['reason']}: the database is damaged or was replaced; stop the DPM and run "
            "`cdff dpm rebuild`, until then nothing is collected"
        )

    def _last_common(self) -> int:
        """Return the ordinal of the last event that is recorded and in the database; note a loss."""
        record = self.files.last()
        if record is None:
            return 0
        newest = Change.parse(record)
        key = [newest.ordinal, newest.stamp_ns]
        with self._database.read() as connection:
            if _contains(connection, newest):
                return newest.ordinal
            if key == self._note["newest"]:  # nothing was written since the loss was noted
                return int(self._note["common"])
            last: int = connection.execute(select(func.max(_e.ordinal))).scalar() or 0
            common = 0
            for change in map(Change.parse, self.files):
                if change.ordinal == last and _contains(connection, change):
                    common = last
        lost_changes = int(self._note["changes"]) + max(newest.ordinal - common, 1)
        reason = f"{lost_changes} acknowledged changes are missing in the database"
        self._write_note(reason, changes=lost_changes, newest=key, common=common)
        return common

    def _read_note(self) -> dict[str, Any]:
        path = self._folder / _LOST
        note: dict[str, Any] = {"reason": "", "changes": 0, "newest": None, "common": 0}
        return note | json.loads(path.read_text("utf-8")) if path.exists() else note

    def _write_note(self, reason: str, **fields: Any) -> None:
        """Note a loss in a file, so that the next process reports it."""
        self._note |= {"reason": reason, **fields}
        replace_file(self._folder / _LOST, json.dumps(self._note).encode(), sync=True)
        logger.error("%s", self.loss)


def changes_after(connection: Connection, ordinal: int, limit: int) -> list[Change]:
    """Return the changes after an ordinal, in order, with the rows that they added."""
    events = dialect_of(connection).fetch(connection, _EVENTS, {"last": ordinal, "limit": limit})
    return [_with_row(connection, Change(*row)) for row in events]


class ServerChanges:
    """Changes of a store whose server has a log of its own, from which it is restored."""

    loss = ""

    def close(self) -> None:
        """Do nothing: the server keeps its log."""


def _contains(connection: Connection, change: Change) -> bool:
    """Return whether the database has the event of a change."""
    rows = dialect_of(connection).fetch(connection, _EVENTS, {"last": change.ordinal - 1, "limit": 1})
    return bool(rows) and Change(*rows[0]) == change._replace(row=None)


_PRODUCTS = (
    select(
        _p.id,
        _p.type_name,
        _p.codec,
        _p.header,
        _p.size,
        _p.inserted_ns,
        _b.chunk_sums,
        _b.location,
        schema.footprints.c.ring,
    )
    .select_from(schema.products)
    .outerjoin(schema.blobs, _b.sha256 == _p.sha256)
    .outerjoin(schema.footprints, schema.footprints.c.ordinal == _p.ordinal)
    .where(_p.id == bindparam("id"))
)
#: Tables of the other rows by the kind of the event, and the fields of its body that are their keys.
_TABLES: dict[str, tuple[Table, dict[str, str]]] = {
    "updated": (schema.annotation_revisions, {"product_id": "id", "revision": "revision"}),
    "reanchored": (schema.frames, {"frame": "frame", "revision": "revision"}),
    "body_defined": (schema.bodies, {"name": "body", "revision": "revision"}),
}


def _with_row(connection: Connection, change: Change) -> Change:
    """Return a change with the row that it added."""
    if change.kind == "inserted":
        rows = dialect_of(connection).fetch(connection, _PRODUCTS, {"id": change.fields.get("id")})
        return change._replace(row=list(rows[0][1:]) if rows else None)
    if change.kind in _TABLES:
        table, keys = _TABLES[change.kind]
        fields = change.fields
        is_key = [table.c[column] == fields.get(field) for column, field in keys.items()]
        row = connection.execute(select(table).where(*is_key)).first()
        return change._replace(row=None if row is None else list(row))
    return change

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Copy of a store, which may be in use, to an empty store of any engine, with its history.

The changes of the source are replayed in their order, in transactions that also advance the position in the
target: a copy that was interrupted continues there. Changes made meanwhile are copied until none is left.
Then the rows of both stores are compared, and every payload of the target is read.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import msgpack
from sqlalchemy import Connection, Select, Table, func, select

from cdff_common.errors import ConfigurationError
from dpm_store.changes.change_recorder import Change, changes_after
from dpm_store.changes.replay import ChangeReplay
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of
from dpm_store.engine.location import parse_url
from dpm_store.engine.migrate import HEAD, revision_of
from dpm_store.payloads.payloads import Payloads
from dpm_store.store import Store

#: Changes in one transaction of the target, and rows compared at once.
_BATCH, _ROWS = 1000, 1000
_NOTE = "migration"
#: Names in ``meta`` that belong to a store itself and are not copied.
_OWN = ("epoch_ns", _NOTE)
#: Compared columns by table, and their order; times of deletion are those of the events.
_p = schema.products.c
_COMPARED: tuple[tuple[Table, tuple[Any, ...]], ...] = (
    (schema.events, tuple(schema.events.c)),
    (
        schema.products,
        (
            _p.ordinal,
            *(c for c in _p if c.name not in ("ordinal", "deleted_ns", "sha256")),
            _p.deleted_ns.is_(None),
        ),
    ),
    (schema.frame_log, tuple(schema.frame_log.c)),
    (schema.poses, tuple(c for c in schema.poses.c if c.name not in ("deleted_ns", "inserted_ns"))),
)
#: Tables without an ordinal, whose rows are compared by their number.
_COUNTED = (
    schema.frames,
    schema.bodies,
    schema.robots,
    schema.footprints,
    schema.product_metrics,
    schema.provenance,
    schema.annotation_revisions,
    schema.product_tags,
    schema.pins,
    schema.supersessions,
    schema.pose_graph_nodes,
    schema.pose_graph_edges,
)


@dataclass(slots=True)
class Migrated:
    """Result of a migration.

    Attributes
    ----------
    changes : int
        Changes copied by this call.
    products : int
        Live products of the target.
    lost : list of str
        Ids of live products of the source whose payload is missing or corrupt there; they became tombstones.
    problems : list of str
        Differences between the stores, and defects of the target.
    """

    changes: int = 0
    products: int = 0
    lost: list[str] = field(default_factory=list)
    problems: list[str] = field(default_factory=list)


def copy_store(
    source_url: str, target: Store, report: Callable[[int, int], None] = lambda *_: None
) -> Migrated:
    """Copy all changes of a store to another one, and verify the copy.

    Parameters
    ----------
    source_url : str
        Store that another process may use.
    target : Store
        Empty, or with an interrupted copy of the source.
    report : callable
        Called with the number of the last copied change and that of the last change.

    Raises
    ------
    ConfigurationError
        If there is no store at the source, its schema is another one, or the target has other contents.
    StorageError
        If a database or the storage of the payloads fails; the next call continues.
    """
    location = parse_url(source_url)
    if location.dialect.FILE_NAME and not (location.directory / location.dialect.FILE_NAME).is_file():
        raise ConfigurationError(f"{source_url}: there is no store")
    source = Database(location.directory, dialect=location.dialect, url=location.database)
    try:
        if (revision := revision_of(source)) != HEAD:
            raise ConfigurationError(
                f"{source_url}: schema {revision}, expected {HEAD}; open the store once with this version"
            )
        payloads = Payloads(location.directory, location.dialect, location.payloads, is_read_only=True)
        return _Migration(source, payloads, target).run(report)
    finally:
        source.close()


class _Migration:
    """Copy of the changes of one store to another."""

    def __init__(self, source: Database, payloads: Payloads, target: Store) -> None:
        self._source = source
        self._target = target
        self._database = target._database
        self._replay = ChangeReplay(self._database, payloads, target._payloads)

    def run(self, report: Callable[[int, int], None]) -> Migrated:
        """Copy until no change is left, and compare."""
        last = self._position()
        while changes := self._read(last):
            with self._database.write() as connection:
                self._replay.apply(connection, changes)
                self._replay.flush()
                last = changes[-1].ordinal
                self._note(connection, last)
            report(last, self._newest())
        self._copy_notes()
        result = Migrated(self._replay.changes, self._target.statistics().count, sorted(self._replay.lost))
        if not result.lost:
            result.problems += self._differences(last)
        result.problems += [f"{problem.where}: {problem.what}" for problem in self._target.verify()]
        return result

    def _read(self, last: int) -> list[Change]:
        with self._source.read() as connection:
            return changes_after(connection, last, _BATCH)

    def _newest(self) -> int:
        with self._source.read() as connection:
            return int(connection.execute(select(func.max(schema.events.c.ordinal))).scalar() or 0)

    def _position(self) -> int:
        """Return the ordinal of the last copied change; raises ConfigurationError for other contents."""
        m, e = schema.meta.c, schema.events.c
        with self._database.read() as connection:
            note = connection.execute(select(m.value).where(m.name == _NOTE)).scalar()
            last = int(connection.execute(select(func.max(e.ordinal))).scalar() or 0)
            event = connection.execute(select(schema.events).where(e.ordinal == last)).first()
        if last == 0:
            return 0
        with self._source.read() as connection:
            original = connection.execute(select(schema.events).where(e.ordinal == last)).first()
        if note is None or json.loads(note) != last or original != event:
            raise ConfigurationError(
                f"store in {self._target.directory}: it has {last} changes that are not a copy of the "
                "source; expected an empty store"
            )
        return last

    @staticmethod
    def _note(connection: Connection, last: int) -> None:
        row = {"name": _NOTE, "value": json.dumps(last)}
        dialect_of(connection).upsert_rows(connection, schema.meta, [row], replace=("value",))

    def _copy_notes(self) -> None:
        """Copy the notes, which are not part of the changes."""
        m = schema.meta.c
        with self._source.read() as connection:
            notes = connection.execute(select(m.name, m.value).where(m.name.not_in(_OWN))).all()
        rows = [{"name": name, "value": value} for name, value in notes]
        with self._database.write() as connection:
            dialect_of(connection).upsert_rows(connection, schema.meta, rows, replace=("value",))

    def _differences(self, last: int) -> Iterator[str]:
        """Yield the differences of the rows; nothing about tables that the source has changed since."""
        for table, columns in _COMPARED:
            position = 0
            while True:
                page = (
                    select(*columns).where(table.c.ordinal > position).order_by(table.c.ordinal).limit(_ROWS)
                )
                copies, originals = _rows(self._database, page), _rows(self._source, page)
                if copies != originals[: len(copies)] and self._newest() == last:
                    first = next((c[0] for c, o in zip(copies, originals, strict=False) if c != o), position)
                    yield f"{table.name}: rows after ordinal {first} differ from those of the source"
                    break
                if len(copies) < _ROWS:
                    break
                position = copies[-1][0]
        for table in _COUNTED:
            count = select(func.count()).select_from(table)
            copied, original = _rows(self._database, count)[0][0], _rows(self._source, count)[0][0]
            if copied != original and self._newest() == last:
                yield f"{table.name}: {copied} rows, expected {original}"


def _rows(database: Database, statement: Select[Any]) -> Sequence[tuple[Any, ...]]:
    with database.read() as connection:
        return [tuple(map(_value, row._fields, row)) for row in connection.execute(statement)]


def _value(column: str, value: Any) -> Any:
    """Return the value of a column that is compared: a header as plain data, in which 1 equals 1.0."""
    return msgpack.unpackb(value) if column == "header" else value

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replay of changes into a database; payloads stay where they are, or are copied."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby
from pathlib import Path
from typing import Any

import msgpack
from sqlalchemy import Connection, Table, func, insert, select, update

from cdff_common.clock import ManualClock
from cdff_common.errors import CdffError, StorageError
from cdff_common.interfaces.product import Header
from dpm_store.changes.change_files import ChangeFiles
from dpm_store.changes.change_recorder import FOLDER, Change
from dpm_store.engine import schema
from dpm_store.engine.database import Database, add_to_tallies, dialect_of
from dpm_store.engine.migrate import migrate
from dpm_store.frames.poses import PoseTable
from dpm_store.history.events import EventTable
from dpm_store.payloads.blobs import digest
from dpm_store.payloads.payloads import PACKED_BYTES, Payloads
from dpm_store.products.annotations import AnnotationTable, restore_revision
from dpm_store.products.insertion import Inserter, PreparedProduct, prepare
from dpm_store.products.records import NAMES, NewProduct

logger = logging.getLogger(__name__)

#: Changes replayed in one transaction, and bytes of their payloads in memory.
_BATCH, _BATCH_BYTES = 1000, 1 << 28


class ChangeReplay:
    """Replay of changes into a database.

    Parameters
    ----------
    database : Database
    payloads : Payloads
        Payloads of the changes.
    target : Payloads, optional
        Payloads of the database, to which those of the changes are copied; the same ones by default.

    Attributes
    ----------
    changes : int
        Replayed changes.
    lost : set of str
        Ids of products that were not deleted and whose payload is missing or corrupt.
    """

    def __init__(self, database: Database, payloads: Payloads, target: Payloads | None = None) -> None:
        self.changes = 0
        self.lost: set[str] = set()
        self._payloads = payloads
        self._target = target
        clock = ManualClock()
        self._inserter = Inserter(target or payloads, EventTable(database, clock), clock)
        self._handlers: dict[str, Callable[[Connection, Change], bool]] = {
            "deleted": self._delete,
            "purged": self._purge,
            "updated": self._annotate,
            "reanchored": self._set_frame,
            "body_defined": self._define_body,
            "robot_described": self._describe_robot,
        }

    def apply(self, connection: Connection, batch: Sequence[Change]) -> None:
        """Replay changes in a transaction; copied payloads are durable after ``flush``."""
        for kind, changes in groupby(batch, lambda change: change.kind):
            self._replay(connection, kind, list(changes))

    def flush(self) -> None:
        """Make copied payloads durable; raises StorageError."""
        if self._target is not None:
            self._target.packs.flush()

    def _replay(self, connection: Connection, kind: str, changes: Sequence[Change]) -> None:
        """Replay successive changes of one kind, and record the applied ones as events."""
        if kind == "inserted" and all(change.row is not None for change in changes):
            replayed = self._insert(connection, changes)
        else:
            apply = self._handlers.get(kind, _keep_event)
            replayed = [change for change in changes if apply(connection, change)]
        names = ("stamp_ns", "scope", "kind", "body")
        rows = [{name: getattr(change, name) for name in names} for change in replayed]
        dialect_of(connection).insert_rows(connection, schema.events, rows)
        self.changes += len(replayed)

    def _insert(self, connection: Connection, changes: Sequence[Change]) -> list[Change]:
        """Insert new products and return their changes; a product without a readable payload becomes a
        tombstone.
        """
        p = schema.products.c
        known_ids: set[str] = set()
        for (
            change
        ) in changes:  # products occur twice if a database created with --new started a second history
            if connection.execute(select(p.id).where(p.id == change.fields["id"])).first() is not None:
                known_ids.add(change.fields["id"])
        new_changes = {c.fields["id"]: c for c in changes if c.fields["id"] not in known_ids}
        restored = [(c, *self._restore_payload(connection, c)) for c in new_changes.values()]
        for (is_lost, inserted_ns), group in groupby(restored, lambda r: (r[1] is None, r[2])):
            if is_lost:
                for change, _, _ in group:
                    self._insert_tombstone(connection, change)
            else:
                items = [item for _, item, _ in group if item is not None]
                self._inserter.insert_rows(connection, items, inserted_ns)
        return list(new_changes.values())

    def _restore_payload(self, connection: Connection, change: Change) -> tuple[PreparedProduct | None, int]:
        """Return the product of a record with its payload, and the time of its insertion.

        The product is None if its payload cannot be read or is invalid.
        """
        product, ring, sums, location, inserted_ns = _product_of(change)
        sha256, size = product.header.sha256 or "", (change.row or [])[3]
        try:
            payload = self._read(sha256, size, sums, location)
        except StorageError:
            return None, inserted_ns
        if self._target is None and size <= PACKED_BYTES:
            _keep_location(connection, sha256, size, sums, location)
        try:
            item = prepare(replace(product, payload=payload))
        except CdffError as error:
            logger.warning("product %s is not restored: %s", product.header.id, error)
            return None, inserted_ns
        if self._target is not None:
            self._inserter.write_files([item])
        return replace(item, ring=ring), inserted_ns

    def _read(self, sha256: str, size: int, sums: bytes | None, location: int | None) -> bytes:
        """Return a payload from its file or pack; raises StorageError if it was collected or damaged."""
        name = f"payload {sha256}"
        if size == 0:
            payload = b""
        elif sums is None:
            raise StorageError(f"{name}: it was collected")
        elif location is None:
            payload = self._payloads.files.read(sha256, size, sums, 0, size, name)
        else:
            payload = self._payloads.packs.read((location, size), sums, name)
        if digest(payload) != sha256:
            raise StorageError(f"{name}: content has another digest")
        return payload

    def _insert_tombstone(self, connection: Connection, change: Change) -> None:
        product, _, _, _, inserted_ns = _product_of(change)
        self._inserter.insert_tombstone(connection, product, (change.row or [])[3], inserted_ns)
        self.lost.add(product.header.id)

    def _delete(self, connection: Connection, change: Change) -> bool:
        """Mark a product as deleted; return whether the change was applied: False for an unknown product."""
        product_id, p = change.fields["id"], schema.products.c
        row = connection.execute(select(p.ordinal, p.deleted_ns).where(p.id == product_id)).first()
        if row is None:
            return False
        connection.execute(
            update(schema.products).where(p.id == product_id).values(deleted_ns=change.stamp_ns)
        )
        if row.deleted_ns is None:
            dialect_of(connection).index_deleted(connection, row.ordinal)
            PoseTable.delete_in(connection, product_id, change.stamp_ns)
        AnnotationTable.remove_from_search_in(connection, product_id)
        self.lost.discard(product_id)  # its payload is missing because it was deleted
        return True

    def _purge(self, connection: Connection, change: Change) -> bool:
        """Remove the reference to the payload of a deleted product; return True: the change was applied."""
        p = schema.products.c
        connection.execute(update(schema.products).where(p.id == change.fields["id"]).values(sha256=None))
        return True

    def _annotate(self, connection: Connection, change: Change) -> bool:
        """Restore a revision of an annotation; return True: the change was applied."""
        values = _row_dict(schema.annotation_revisions, change)
        if values is not None:
            restore_revision(connection, values)
        return True

    def _set_frame(self, connection: Connection, change: Change) -> bool:
        """Restore a revision of a frame; return True: the change was applied."""
        values = _insert_revision(connection, schema.frames, "frame", change)
        if values is not None:
            entry = {"frame": values["frame"], "revision": values["revision"]}
            connection.execute(insert(schema.frame_log), entry)
        return True

    def _define_body(self, connection: Connection, change: Change) -> bool:
        """Restore a revision of a body; return True: the change was applied."""
        _insert_revision(connection, schema.bodies, "name", change)
        return True

    def _describe_robot(self, connection: Connection, change: Change) -> bool:
        """Restore the description of a robot; return True: the change was applied."""
        body = change.fields
        row = {
            "robot": change.scope,
            "doc": body["doc"],
            "description": msgpack.packb(body["description"]),
            "inserted_ns": change.stamp_ns,
            "updated_ns": change.stamp_ns,
        }
        changing = ("doc", "description", "updated_ns")
        dialect_of(connection).upsert_rows(connection, schema.robots, [row], replace=changing)
        return True


class Replay(ChangeReplay):
    """Replay of the records of a store into a new database.

    Parameters
    ----------
    directory : Path
        Directory of the store.
    target : Path
        Directory of the new database.
    """

    def __init__(self, directory: Path, target: Path) -> None:
        self._records = ChangeFiles(directory / FOLDER)
        self._database = Database(target)
        super().__init__(self._database, Payloads(directory))

    def run(self) -> None:
        """Replay everything and close the database."""
        try:
            migrate(self._database)
            for batch in _batches(map(Change.parse, self._records)):
                with self._database.write() as connection:
                    self.apply(connection, batch)
        finally:
            self._payloads.packs.close()
            self._database.close()


def _keep_event(connection: Connection, change: Change) -> bool:
    """Accept an event without further tables; return True: the change was applied.

    An event from the journal of another service also restores the number up to which that journal was read.
    """
    body = change.fields if change.kind != "inserted" else {}
    origin, number = body.get("origin"), body.get("number")
    if isinstance(origin, str) and isinstance(number, int):
        value = {"name": f"history:{origin}", "value": str(number)}
        dialect_of(connection).upsert_rows(connection, schema.meta, [value], replace=("value",))
    return True


def _batches(changes: Iterator[Change]) -> Iterator[list[Change]]:
    """Yield batches of changes, bounded by their number and by the bytes of the inserted payloads."""
    batch: list[Change] = []
    size = 0
    for change in changes:
        batch.append(change)
        size += change.row[3] if change.kind == "inserted" and change.row is not None else 0
        if len(batch) == _BATCH or size > _BATCH_BYTES:
            yield batch
            batch, size = [], 0
    if batch:
        yield batch


def _product_of(change: Change) -> tuple[NewProduct, bytes | None, bytes | None, int | None, int]:
    """Return a product without its payload, its outline, chunk sums, location and time of insertion."""
    type_name, codec, header, _, inserted_ns, sums, location, ring = change.row or []
    names = {name: change.fields[name] for name in NAMES}
    product = NewProduct(
        Header.from_dict(msgpack.unpackb(header)), b"", **names, type_name=type_name, codec=codec
    )
    return product, ring, sums, location, inserted_ns


def _keep_location(
    connection: Connection, sha256: str, size: int, sums: bytes | None, location: int | None
) -> None:
    """Insert the row of a payload at its present location, so that the insertion does not write the payload
    again.
    """
    b = schema.blobs.c
    if connection.execute(select(b.sha256).where(b.sha256 == sha256)).first() is None:
        row = {"sha256": sha256, "size": size, "chunk_sums": sums or b"", "location": location, "live": 0}
        connection.execute(insert(schema.blobs), row)
        add_to_tallies(connection, schema.blob_tallies, [((location is not None,), size)])


def _insert_revision(connection: Connection, table: Table, key: str, change: Change) -> dict[str, Any] | None:
    """Insert the row of a change as the next revision; return its values, None if the change has no row."""
    values = _row_dict(table, change)
    if values is not None:
        last = select(func.max(table.c.revision)).where(table.c[key] == values[key])
        values["revision"] = int(connection.execute(last).scalar() or 0) + 1
        connection.execute(insert(table), values)
    return values


def _row_dict(table: Table, change: Change) -> dict[str, Any] | None:
    if change.row is None:
        return None
    return dict(zip((column.name for column in table.columns), change.row, strict=True))

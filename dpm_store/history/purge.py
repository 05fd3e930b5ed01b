# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Immediate removal of the payload of a deleted product; its metadata stay."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Row, exists, select, update

from cdff_common.errors import ConflictError
from dpm_store.engine import schema
from dpm_store.engine.database import Database
from dpm_store.history.events import EventTable
from dpm_store.payloads.payloads import Payloads
from dpm_store.products.pose_graphs import delete_in
from dpm_store.products.products import row_of


def purge(database: Database, payloads: Payloads, events: EventTable, product_id: str) -> int:
    """Remove the payload of a deleted product; return the bytes freed, 0 if another product shares it.

    Raises
    ------
    ProductNotFoundError
        If the id is unknown.
    ConflictError
        If the product is not deleted.
    """
    p = schema.products.c
    with database.deletion() as connection:
        row = row_of(connection, product_id)
        if row.deleted_ns is None:
            raise ConflictError(f"product {product_id} is not deleted: delete it first, then purge it")
        if row.sha256 is None:
            return 0
        connection.execute(update(schema.products).where(p.id == product_id).values(sha256=None))
        delete_in(connection, product_id)
        body: dict[str, Any] = {"id": product_id, "sha256": row.sha256, "size": row.size}
        events.append(row.robot, "purged", body, connection=connection)
        blob = _delete_blob(connection, row.sha256)
    if blob is None:
        return 0
    payloads.set_intact([row.sha256])
    if blob.location is not None:
        payloads.mark_unreferenced(blob.location)
        payloads.reclaim(database)
        return int(row.size)
    # the row is deleted before the file: a put meanwhile waits for the lock and writes the file again
    with database.deletion() as connection:
        return 0 if _has_row(connection, row.sha256) else payloads.files.remove(row.sha256)


def _delete_blob(connection: Connection, sha256: str) -> Row[Any] | None:
    """Delete and return the row of a payload; None if a product refers to it."""
    p, b = schema.products.c, schema.blobs.c
    of_tombstone = exists().where(p.sha256 == sha256, p.sha256.is_not(None), p.deleted_ns.is_not(None))
    row = connection.execute(select(b.location).where(b.sha256 == sha256, b.live == 0, ~of_tombstone)).first()
    if row is not None:
        connection.execute(schema.blobs.delete().where(b.sha256 == sha256))
    return row


def _has_row(connection: Connection, sha256: str) -> bool:
    b = schema.blobs.c
    return connection.execute(select(b.sha256).where(b.sha256 == sha256)).first() is not None

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The payload of one deleted product goes at once; what was known of it stays, and its id is not free again."""

from __future__ import annotations

from typing import Any

from sqlalchemy import Connection, Row, exists, select, update

from cdff_common.errors import ConflictError, ProductNotFoundError
from dpm_store import schema
from dpm_store.database import Database
from dpm_store.events import EventTable
from dpm_store.payloads import Payloads
from dpm_store.pose_graphs import forget_in


def purge(database: Database, payloads: Payloads, events: EventTable, product_id: str) -> int:
    """Remove the payload of a deleted product; returns the bytes freed, 0 where another product has the same content.

    Raises
    ------
    ProductNotFoundError
        For an unknown id.
    ConflictError
        If the product was not deleted before.
    """
    p = schema.products.c
    with database.freeing() as connection:
        row = connection.execute(select(schema.products).where(p.id == product_id)).first()
        if row is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        if row.deleted_ns is None:
            raise ConflictError(f"product {product_id} is not deleted: delete it first, then purge it")
        if row.sha256 is None:
            return 0
        connection.execute(update(schema.products).where(p.id == product_id).values(sha256=None))
        forget_in(connection, product_id)
        body: dict[str, Any] = {"id": product_id, "sha256": row.sha256, "size": row.size}
        events.append_in(connection, row.robot, "purged", body)
        blob = _forget(connection, row.sha256)
    if blob is None:
        return 0
    if blob.place is not None:
        payloads.lost(blob.place)
        payloads.reclaim(database)
        return int(row.size)
    # the row is gone for good before the file is; a put meanwhile waits for the lock and writes its file anew
    with database.freeing() as connection:
        return payloads.files.remove(row.sha256) if not _is_named(connection, row.sha256) else 0


def _forget(connection: Connection, sha256: str) -> Row[Any] | None:
    """Take the row of a payload out that no product names any more; None where one does."""
    p, b = schema.products.c, schema.blobs.c
    of_tombstone = exists().where(p.sha256 == sha256, p.sha256.is_not(None), p.deleted_ns.is_not(None))
    found = connection.execute(select(b.place).where(b.sha256 == sha256, b.live == 0, ~of_tombstone)).first()
    if found is not None:
        connection.execute(schema.blobs.delete().where(b.sha256 == sha256))
    return found


def _is_named(connection: Connection, sha256: str) -> bool:
    b = schema.blobs.c
    return connection.execute(select(b.sha256).where(b.sha256 == sha256)).first() is not None

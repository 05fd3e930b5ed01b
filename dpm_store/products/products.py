# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The table of products: insertion, retrieval by id, and deletion by a tombstone."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from sqlalchemy import Connection, Row, bindparam, select, update

from cdff_common.clock import Clock
from cdff_common.errors import ConflictError, InputError, ProductNotFoundError, StorageError
from dpm_store.engine import schema
from dpm_store.engine.database import Database, dialect_of
from dpm_store.frames.poses import PoseTable
from dpm_store.history.events import EventTable
from dpm_store.payloads.payloads import Payloads
from dpm_store.products.annotations import AnnotationTable, is_pinned
from dpm_store.products.insertion import Inserter, PreparedProduct, event_body, prepare, stored_products
from dpm_store.products.records import Insertion, NewProduct, ProductRecord

#: Columns of ``products`` in the order of ``ProductRecord``.
RECORD_COLUMNS = tuple("header" if name == "packed_header" else name for name in ProductRecord._fields)
#: Products in one transaction.
MAX_BATCH = 10_000
#: Payloads looked up by one statement.
_PAYLOADS = 128
#: The payload of a live product, by the id of the product.
_PAYLOAD_ROW = (
    select(schema.blobs.c.sha256, schema.blobs.c.size, schema.blobs.c.chunk_sums, schema.blobs.c.location)
    .join_from(schema.products, schema.blobs)
    .where(schema.products.c.id == bindparam("id"), schema.products.c.deleted_ns.is_(None))
)


class ProductTable:
    """Products with their payloads, index and provenance.

    Attributes
    ----------
    inserter : Inserter
        Insertion inside a transaction.
    """

    def __init__(
        self,
        database: Database,
        payloads: Payloads,
        events: EventTable,
        annotations: AnnotationTable,
        clock: Clock,
    ) -> None:
        self._database = database
        self._payloads = payloads
        self._annotations = annotations
        self._events = events
        self._clock = clock
        self.inserter = Inserter(payloads, events, clock)

    def put_all(self, products: Sequence[NewProduct]) -> tuple[Insertion, ...]:
        """Insert products in one transaction, all or none; they are durable when this returns.

        Returns
        -------
        tuple of Insertion
            ALREADY for a product that is stored with the same content.

        Raises
        ------
        InputError
            On more than ``MAX_BATCH``, an id that occurs twice, a malformed name, a box that is not finite,
            or a payload over 1 GiB.
        CodecError
            If a digest does not match, or the payload of a pose cannot be decoded.
        ConflictError
            If an id exists with other content, or was deleted.
        StorageError
            If the disk is full or fails; the product is not stored.
        """
        prepared = self.prepare(products)
        with self._database.write() as connection:
            return tuple(self.inserter.insert_in(connection, prepared))

    def prepare(self, products: Sequence[NewProduct]) -> list[PreparedProduct]:
        """Check products and make their payload files durable, before the transaction that inserts them."""
        if len(products) > MAX_BATCH or len({product.header.id for product in products}) != len(products):
            raise InputError(f"batch of {len(products)}: expected at most {MAX_BATCH}, each id once")
        prepared = [prepare(product) for product in products]
        self._database.admit(sum(len(item.product.payload) for item in prepared))
        large = [item for item in prepared if not item.is_packed]
        if large:  # a product that is refused for its id leaves no file behind
            with self._database.read() as connection:
                stored = stored_products(connection, large)
            self.inserter.write_files(item for item in large if item.header.id not in stored)
        return prepared

    def get(self, product_id: str, *, deleted: bool = False) -> ProductRecord:
        """Return metadata by id; raises ProductNotFoundError if unknown, or deleted unless ``deleted``."""
        with self._database.read() as connection:
            row = row_of(connection, product_id)
        if row.deleted_ns is not None and not deleted:
            raise ProductNotFoundError(f"product {product_id} was deleted")
        return record_of(row)

    def live(self, product_ids: Iterable[str]) -> frozenset[str]:
        """Return the ids whose products are stored and not deleted."""
        ids = sorted(product_ids)
        if not ids:
            return frozenset()
        p = schema.products.c
        with self._database.read() as connection:
            dialect = dialect_of(connection)
            statement = select(p.id).where(p.id.in_(dialect.elements("ids")), p.deleted_ns.is_(None))
            rows = connection.execute(statement, {"ids": dialect.list_value(ids)})
            return frozenset(rows.scalars())

    def payload(self, product_id: str, offset: int = 0, length: int | None = None) -> bytes:
        """Return bytes of a payload after comparison with its sums.

        Raises
        ------
        ProductNotFoundError
            If the product is unknown or deleted.
        InputError
            If the offset is beyond the end or the length negative.
        StorageError
            If the payload is corrupt.
        """
        row = self._payload_row(product_id)
        if not 0 <= offset <= row.size or (length is not None and length < 0):
            raise InputError(f"product {product_id}: offset {offset}, length {length} of {row.size} bytes")
        read_length = row.size - offset if length is None else min(length, row.size - offset)
        while True:
            try:
                return self._payloads.read(row, offset, read_length, f"product {product_id}")
            except StorageError:
                if (current_row := self._payload_row(product_id)) == row:
                    raise
                self._payloads.set_intact([row.sha256])
                row = current_row  # repaired, or deleted and stored again meanwhile

    def _payload_row(self, product_id: str) -> Any:
        with self._database.read() as connection:
            row = connection.execute(_PAYLOAD_ROW, {"id": product_id}).first()
        if row is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        return row

    def payloads(self, product_ids: Sequence[str]) -> Iterator[tuple[str, bytes]]:
        """Return ids and whole checked payloads, in any order and a few in memory at a time.

        Payloads of deleted products are included until they are collected; unknown products are omitted.
        """
        p, b = schema.products.c, schema.blobs.c
        for first in range(0, len(product_ids), _PAYLOADS):
            statement = (
                select(p.id, b.sha256, b.size, b.chunk_sums, b.location)
                .join_from(schema.products, schema.blobs)
                .where(p.id.in_(product_ids[first : first + _PAYLOADS]))
            )
            with self._database.read() as connection:
                rows = connection.execute(statement).all()
            for row in rows:
                yield row.id, self._payloads.read(row, 0, row.size, f"product {row.id}")

    def delete(self, product_id: str, *, connection: Connection | None = None) -> bool:
        """Replace a product by a tombstone, whose id cannot be used again; return False if it was deleted.

        Raises
        ------
        ProductNotFoundError
            If the id is unknown.
        ConflictError
            If it is pinned.
        """
        with self._database.deletion(connection) as connection:
            row = row_of(connection, product_id)
            if row.deleted_ns is not None:
                return False
            if is_pinned(connection, product_id):
                raise ConflictError(f"product {product_id} is pinned: unpin it first")
            deleted_ns = self._clock.now_ns()
            is_product = schema.products.c.id == product_id
            connection.execute(update(schema.products).where(is_product).values(deleted_ns=deleted_ns))
            self._database.dialect.index_deleted(connection, row.ordinal)
            PoseTable.delete_in(connection, product_id, deleted_ns)
            self._annotations.remove_from_search_in(connection, product_id)
            record = record_of(row)
            body = event_body(record.header, record.names)
            self._events.append(record.robot, "deleted", body, connection=connection)
            return True


def row_of(connection: Connection, product_id: str) -> Row[Any]:
    """Return the row of a live or deleted product; raises ProductNotFoundError for an unknown id."""
    row = connection.execute(select(schema.products).where(schema.products.c.id == product_id)).first()
    if row is None:
        raise ProductNotFoundError(f"no product {product_id[:64]!r}")
    return row


def record_of(row: Row[Any]) -> ProductRecord:
    """Return the metadata in a row of ``products``."""
    return ProductRecord._make([getattr(row, name) for name in RECORD_COLUMNS])

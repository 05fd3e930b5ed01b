# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products: inserted once, found by id, deleted by a tombstone. Payload first, then row and index in one commit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from sqlalchemy import Connection, Row, func, select, update

from cdff_common.clock import Clock
from cdff_common.errors import ConflictError, InputError, ProductNotFoundError, StorageError
from cdff_common.interfaces.product import Header
from dpm_store import schema, sqlite
from dpm_store.annotations import AnnotationTable, is_pinned
from dpm_store.database import Database
from dpm_store.events import EventTable
from dpm_store.insertion import Inserter, Ready, compare, event_body, prepared
from dpm_store.payloads import Payloads
from dpm_store.poses import PoseTable
from dpm_store.records import Insertion, Parcel, ProductRecord

#: Columns of ``products`` that make a record, in its order.
RECORD_COLUMNS = (
    "ordinal", "robot", "dfpc", "port", "product", "type_name", "codec", "id", "t1_ns", "header", "size", "inserted_ns",
    "deleted_ns",
)  # fmt: skip
#: Products in one transaction.
MAX_BATCH = 10_000
#: Payloads looked up by one statement.
_TOGETHER = 128


class ProductTable:
    """Products with their payloads, index and provenance."""

    def __init__(
        self, database: Database, payloads: Payloads, events: EventTable, annotations: AnnotationTable, clock: Clock
    ) -> None:
        self._database = database
        self._payloads = payloads
        self._annotations = annotations
        self._events = events
        self._clock = clock
        self._inserter = Inserter(payloads, events, clock)

    def put(
        self, header: Header, payload: bytes, *, robot: str, dfpc: str, port: str, product: str, type_name: str,
        codec: str = "uper", value: Any = None,
    ) -> Insertion:  # fmt: skip
        """Insert a product; durable when this returns.

        Parameters
        ----------
        header : Header
            Its ``box_m`` is what is found by region.
        payload : bytes
            The value of ``type_name`` in ``codec``.
        value : optional
            The decoded payload where the caller has it: poses are entered in the series from it.

        Returns
        -------
        Insertion
            ALREADY if the same product with the same content is there.

        Raises
        ------
        InputError
            On a malformed name, a box that is not finite, a digest that does not fit, a payload over 1 GiB.
        CodecError
            If the payload of a pose cannot be decoded.
        ConflictError
            If the id is there with other content, or was deleted.
        StorageError
            If the disk is full or fails; nothing is stored then.
        """
        return self.put_all((Parcel(header, payload, robot, dfpc, port, product, type_name, codec, value),))[0]

    def put_all(self, parcels: Sequence[Parcel]) -> tuple[Insertion, ...]:
        """Insert products in one transaction: all of them, or none; see ``put``.

        Raises
        ------
        InputError
            On more than ``MAX_BATCH``, an id that occurs twice, and as ``put``.
        """
        ready = self.prepare(parcels)
        with self._database.write() as connection:
            return tuple(self.insert_in(connection, ready))

    def prepare(self, parcels: Sequence[Parcel]) -> list[Ready]:
        """Check parcels and make durable what goes into files, before the transaction that enters them."""
        if len(parcels) > MAX_BATCH or len({parcel.header.id for parcel in parcels}) != len(parcels):
            raise InputError(f"batch of {len(parcels)}: expected at most {MAX_BATCH}, each id once")
        ready = [prepared(parcel) for parcel in parcels]
        self._database.admit(sum(len(item.parcel.payload) for item in ready))
        large = [item for item in ready if not item.is_packed]
        if large:  # what is refused for its id leaves no file behind
            with self._database.read() as connection:
                known = compare(connection, large)
            self._inserter.write_files(item for item in large if item.header.id not in known)
        return ready

    def insert_in(self, connection: Connection, ready: Sequence[Ready]) -> list[Insertion]:
        """Enter what was prepared, inside a transaction; see ``Inserter.insert_in``."""
        return self._inserter.insert_in(connection, ready)

    def get(self, product_id: str, *, deleted: bool = False) -> ProductRecord:
        """Metadata by id; raises ProductNotFoundError for an unknown one, or a deleted one unless ``deleted``."""
        with self._database.read() as connection:
            row = connection.execute(select(schema.products).where(schema.products.c.id == product_id)).first()
        if row is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        if row.deleted_ns is not None and not deleted:
            raise ProductNotFoundError(f"product {product_id} was deleted")
        return record_of(row)

    def payload(self, product_id: str, offset: int = 0, length: int | None = None) -> bytes:
        """Bytes of a payload, checked against what was written.

        Raises
        ------
        ProductNotFoundError
            For an unknown or deleted product.
        InputError
            If the offset is beyond the end or the length negative.
        StorageError
            If the disk gave back something else than was written.
        """
        row = self._payload_row(product_id)
        if not 0 <= offset <= row.size or (length is not None and length < 0):
            raise InputError(f"product {product_id}: offset {offset}, length {length} of {row.size} bytes")
        wanted = row.size - offset if length is None else min(length, row.size - offset)
        while True:
            try:
                return self._payloads.read(row, offset, wanted, f"product {product_id}")
            except StorageError:
                if (now := self._payload_row(product_id)) == row:
                    raise
                row = now  # mended, or deleted and stored anew meanwhile

    def _payload_row(self, product_id: str) -> Any:
        p, b = schema.products.c, schema.blobs.c
        statement = (
            select(b.sha256, b.size, b.chunk_sums, b.place).join_from(schema.products, schema.blobs)
            .where(p.id == product_id, p.deleted_ns.is_(None))
        )  # fmt: skip
        with self._database.read() as connection:
            row = connection.execute(statement).first()
        if row is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        return row

    def payloads(self, product_ids: Sequence[str]) -> Iterator[tuple[str, bytes]]:
        """Ids and whole payloads, checked, in any order and a few in memory at a time.

        Those of deleted products are among them as long as they are kept; unknown and purged ones are left out.
        """
        p, b = schema.products.c, schema.blobs.c
        for first in range(0, len(product_ids), _TOGETHER):
            statement = (
                select(p.id, b.sha256, b.size, b.chunk_sums, b.place).join_from(schema.products, schema.blobs)
                .where(p.id.in_(product_ids[first : first + _TOGETHER]))
            )  # fmt: skip
            with self._database.read() as connection:
                rows = connection.execute(statement).all()
            for row in rows:
                yield row.id, self._payloads.read(row, 0, row.size, f"product {row.id}")

    def delete(self, product_id: str) -> bool:
        """Leave a tombstone: not found any more, its id not free again. False if it was deleted before.

        Raises
        ------
        ProductNotFoundError
            For an unknown id.
        ConflictError
            If it is pinned.
        """
        with self._database.freeing() as connection:
            return self.delete_in(connection, product_id)

    def delete_in(self, connection: Connection, product_id: str) -> bool:
        """As ``delete``, inside a transaction."""
        p = schema.products.c
        row = connection.execute(select(schema.products).where(p.id == product_id)).first()
        if row is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        if row.deleted_ns is not None:
            return False
        if is_pinned(connection, product_id):
            raise ConflictError(f"product {product_id} is pinned: unpin it first")
        gone = {"deleted_ns": self._clock.now_ns()}
        connection.execute(update(schema.products).where(p.id == product_id).values(gone))
        sqlite.unindex_product(connection, row.ordinal)
        PoseTable.delete_in(connection, product_id, gone["deleted_ns"])
        self._annotations.forget_in(connection, product_id)
        record = record_of(row)
        names = {"robot": record.robot, "dfpc": record.dfpc, "port": record.port, "product": record.product}
        self._events.append_in(connection, record.robot, "deleted", event_body(record.header, names))
        return True

    def count(self) -> int:
        """How many products are there, deleted ones left out."""
        with self._database.read() as connection:
            statement = select(func.count()).select_from(schema.products).where(schema.products.c.deleted_ns.is_(None))
            return int(connection.execute(statement).scalar_one())


def record_of(row: Row[Any]) -> ProductRecord:
    """Metadata from a row of ``products``."""
    return ProductRecord._make([getattr(row, name) for name in RECORD_COLUMNS])

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products: inserted once, found by id, deleted by a tombstone. Payload first, then row and index in one commit."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgpack
import numpy as np
from sqlalchemy import Connection, Row, func, insert, select, update

from cdff_common.clock import NS_PER_S, Clock
from cdff_common.errors import CodecError, ConflictError, InputError, ProductNotFoundError
from cdff_common.interfaces.product import Header
from dpm_store import schema, sqlite
from dpm_store.annotations import AnnotationTable, is_pinned
from dpm_store.blobs import CHUNK_BYTES, BlobFiles, check_chunks, chunk_sums, covering, digest
from dpm_store.database import Database
from dpm_store.events import EventTable
from dpm_store.footprints import footprint_of, ring_bytes
from dpm_store.poses import PoseTable
from dpm_store.records import LATEST_NS, Insertion, Parcel, ProductRecord

#: Smaller payloads lie in the row's own database: one sync instead of three.
INLINE_BYTES = 1 << 15
#: Payloads looked up by one statement.
_TOGETHER = 128
MAX_PAYLOAD_BYTES = 1 << 30
#: Of a number in the quality, to be found by.
MAX_METRIC_NAME = 64
#: Products in one transaction.
MAX_BATCH = 10_000
#: Products whose payload is also entered in the pose series.
_POSES = ("TransformWithCovariance",)
_NAME = re.compile(r"[a-z0-9_]{1,64}\Z")
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_\-]{0,63}\Z")
_CODECS = ("uper", "ber", "xer", "msgpack")
_EPOCH = "epoch_ns"


@dataclass(frozen=True, slots=True)
class _Ready:
    """A parcel that was checked; the header has its digest."""

    parcel: Parcel
    header: Header
    chunk_sums: bytes
    poses: list[tuple[int, Any]] | None
    ring: bytes | None = None


class ProductTable:
    """Products with their payloads, index and provenance."""

    def __init__(
        self, database: Database, files: BlobFiles, events: EventTable, annotations: AnnotationTable, clock: Clock
    ) -> None:
        self._database = database
        self._files = files
        self._annotations = annotations
        self._events = events
        self._clock = clock

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
        if len(parcels) > MAX_BATCH or len({parcel.header.id for parcel in parcels}) != len(parcels):
            raise InputError(f"batch of {len(parcels)}: expected at most {MAX_BATCH}, each id once")
        ready = [_prepared(parcel) for parcel in parcels]
        with self._database.read() as connection:
            known = [self._compare(connection, item.parcel, item.header) for item in ready]
        new = [item for item, there in zip(ready, known, strict=True) if there is None]
        if new:
            self._database.admit(sum(len(item.parcel.payload) for item in new))
            for item in new:
                self._write_file(item)
            with self._database.write() as connection:
                found = [self._insert_in(connection, item) for item in new]
            outcome = iter(found)
            return tuple(next(outcome) if there is None else there for there in known)
        return tuple(there for there in known if there is not None)

    def _insert_in(self, connection: Connection, item: _Ready) -> Insertion:
        parcel, header = item.parcel, item.header
        if (known := self._compare(connection, parcel, header)) is not None:
            return known
        self._write_file(item)  # again only if a purge took it since
        inline = parcel.payload if len(parcel.payload) <= INLINE_BYTES else None
        blob = {
            "sha256": header.sha256, "size": len(parcel.payload), "chunk_sums": item.chunk_sums, "content": inline,
        }  # fmt: skip
        connection.execute(sqlite.insert_new(schema.blobs), blob)
        ordinal = self._insert_row(
            connection, header, parcel.names, parcel.type_name, parcel.codec, len(parcel.payload)
        )
        self._index(connection, ordinal, header)
        if item.ring is not None:
            connection.execute(insert(schema.footprints), {"ordinal": ordinal, "ring": item.ring})
        metrics = {n: v for n, v in header.quality.metrics.items() if len(n) <= MAX_METRIC_NAME and math.isfinite(v)}
        if metrics:
            rows = [{"ordinal": ordinal, "name": name, "value": value} for name, value in metrics.items()]
            connection.execute(insert(schema.product_metrics), rows)
        if header.inputs:
            links = [{"product_id": header.id, "input_id": i} for i in dict.fromkeys(header.inputs)]
            connection.execute(insert(schema.provenance), links)
        if item.poses is not None and header.child is not None:
            PoseTable.add_in(
                connection, parcel.robot, f"{parcel.dfpc}/{parcel.port}", item.poses, parent=header.frame,
                child=header.child, product_id=header.id, inserted_ns=self._clock.now_ns(),
            )  # fmt: skip
        self._events.append_in(connection, parcel.robot, "inserted", event_body(header, parcel.names))
        return Insertion.INSERTED

    def _write_file(self, item: _Ready) -> None:
        if len(item.parcel.payload) > INLINE_BYTES:
            self._files.write(item.header.sha256 or "", item.parcel.payload)

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
        p, b = schema.products.c, schema.blobs.c
        statement = (
            select(b.sha256, b.size, b.chunk_sums, b.content).join_from(schema.products, schema.blobs)
            .where(p.id == product_id, p.deleted_ns.is_(None))
        )  # fmt: skip
        with self._database.read() as connection:
            row = connection.execute(statement).first()
        if row is None:
            raise ProductNotFoundError(f"no product {product_id[:64]!r}")
        if not 0 <= offset <= row.size or (length is not None and length < 0):
            raise InputError(f"product {product_id}: offset {offset}, length {length} of {row.size} bytes")
        wanted = row.size - offset if length is None else min(length, row.size - offset)
        if wanted == 0:
            return b""
        return self._content(row, product_id, offset, wanted)

    def payloads(self, product_ids: Sequence[str]) -> Iterator[tuple[str, bytes]]:
        """Ids and whole payloads, checked, in any order and a few in memory at a time.

        Those of deleted products are among them as long as they are kept; unknown and purged ones are left out.
        """
        p, b = schema.products.c, schema.blobs.c
        for first in range(0, len(product_ids), _TOGETHER):
            statement = (
                select(p.id, b.sha256, b.size, b.chunk_sums, b.content).join_from(schema.products, schema.blobs)
                .where(p.id.in_(product_ids[first : first + _TOGETHER]))
            )  # fmt: skip
            with self._database.read() as connection:
                rows = connection.execute(statement).all()
            for row in rows:
                yield row.id, self._content(row, row.id, 0, row.size) if row.size else b""

    def _content(self, row: Any, product_id: str, offset: int, wanted: int) -> bytes:
        what = f"product {product_id}"
        if row.content is None:
            return self._files.read(row.sha256, row.size, row.chunk_sums, offset, wanted, what)
        first, last = covering(offset, wanted)
        check_chunks(row.content[first * CHUNK_BYTES : last * CHUNK_BYTES], first, row.chunk_sums, what)
        return bytes(row.content[offset : offset + wanted])

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

    def epoch_ns(self, connection: Connection) -> int | None:
        """Time that index times are counted from; None before the first product."""
        value = connection.execute(select(schema.meta.c.value).where(schema.meta.c.name == _EPOCH)).scalar()
        return None if value is None else int(value)

    @staticmethod
    def _compare(connection: Connection, parcel: Parcel, header: Header) -> Insertion | None:
        row = connection.execute(select(schema.products).where(schema.products.c.id == header.id)).first()
        if row is None:
            return None
        if row.deleted_ns is not None:
            raise ConflictError(f"product {header.id} was deleted; its id is not free again")
        there = record_of(row)
        wanted = {**parcel.names, "type_name": parcel.type_name, "codec": parcel.codec, "size": len(parcel.payload)}
        if {name: getattr(there, name) for name in wanted} == wanted and there.header == header:
            return Insertion.ALREADY
        raise ConflictError(f"product {header.id} is there with other content; a new result needs a new id")

    def _insert_row(
        self, connection: Connection, header: Header, names: dict[str, str], type_name: str, codec: str, size: int
    ) -> int:
        box = header.box_m or (None,) * 6
        row = {
            **names, "id": header.id, "type_name": type_name, "codec": codec, "frame": header.frame,
            "child": header.child, "config_hash": header.config_hash, "t0_ns": header.t0_ns, "t1_ns": header.t1_ns,
            "resolution_m": header.resolution_m,
            "status": str(header.quality.status), "covariance_kind": str(header.quality.covariance_kind),
            "header": msgpack.packb(header.to_dict()), "sha256": header.sha256,
            "size": size, "inserted_ns": self._clock.now_ns(), "xmin_m": box[0], "ymin_m": box[1], "zmin_m": box[2],
            "xmax_m": box[3], "ymax_m": box[4], "zmax_m": box[5],
        }  # fmt: skip
        ordinal: int = connection.execute(
            insert(schema.products).returning(schema.products.c.ordinal), row
        ).scalar_one()
        return ordinal

    def _index(self, connection: Connection, ordinal: int, header: Header) -> None:
        n = schema.frame_names.c
        connection.execute(sqlite.insert_new(schema.frame_names), {"frame": header.frame})
        epoch = self.epoch_ns(connection)
        if epoch is None:
            epoch = header.t0_ns
            connection.execute(insert(schema.meta), {"name": _EPOCH, "value": str(epoch)})
        if header.box_m is None:
            return
        frame: int = connection.execute(select(n.ordinal).where(n.frame == header.frame)).scalar_one()
        span_s = ((header.t0_ns - epoch) / NS_PER_S, (header.t1_ns - epoch) / NS_PER_S)
        sqlite.index_product(connection, ordinal, frame, header.box_m, span_s)

    def count(self) -> int:
        """How many products are there, deleted ones left out."""
        with self._database.read() as connection:
            statement = select(func.count()).select_from(schema.products).where(schema.products.c.deleted_ns.is_(None))
            return int(connection.execute(statement).scalar_one())


def record_of(row: Row[Any]) -> ProductRecord:
    """Metadata from a row of ``products``."""
    return ProductRecord(
        row.ordinal, row.robot, row.dfpc, row.port, row.product, row.type_name, row.codec,
        Header.from_dict(msgpack.unpackb(row.header)), row.size, row.inserted_ns, row.deleted_ns,
    )  # fmt: skip


def event_body(header: Header, names: dict[str, str]) -> dict[str, Any]:
    """What an event says of a product."""
    body: dict[str, Any] = {
        "id": header.id, **names, "frame": header.frame, "t0_ns": header.t0_ns, "t1_ns": header.t1_ns,
        "status": str(header.quality.status),
    }  # fmt: skip
    return body if header.box_m is None else body | {"box_m": list(header.box_m)}


def _checked(header: Header, payload: bytes, names: dict[str, str], type_name: str, codec: str) -> str:
    for what, name in names.items():
        if not _NAME.match(name):
            raise InputError(f"{what}={name[:80]!r}: expected lower case letters, digits and _, at most 64")
    if not _TYPE.match(type_name):
        raise InputError(f"type {type_name[:80]!r}: expected the name of an ASN.1 type")
    if codec not in _CODECS:
        raise InputError(f"codec {codec[:80]!r}: expected one of {', '.join(_CODECS)}")
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise InputError(f"payload of {len(payload)} bytes: expected at most {MAX_PAYLOAD_BYTES}")
    if max(abs(header.t0_ns), abs(header.t1_ns)) > LATEST_NS or not 0 <= header.seq <= LATEST_NS:
        raise InputError(f"capture {header.t0_ns}..{header.t1_ns}, seq {header.seq}: out of range")
    box = header.box_m
    if box is not None and (not all(math.isfinite(v) for v in box) or any(box[i] > box[i + 3] for i in range(3))):
        raise InputError(f"box_m={box}: expected finite metres, each minimum at or below its maximum")
    _check_footprint(header)
    sha256 = digest(payload)
    if header.sha256 not in (None, sha256):
        raise CodecError(f"product {header.id}: payload has SHA-256 {sha256}, its header says {header.sha256}")
    return sha256


def _check_footprint(header: Header) -> None:
    """Refuse a footprint without a box, with numbers that are not finite, out of the box, or that crosses itself."""
    if header.footprint_m is None:
        return
    import shapely

    ring, box = np.array(header.footprint_m).reshape(-1, 2), header.box_m
    if box is None or not np.isfinite(ring).all():
        raise InputError("footprint_m: expected finite metres, beside a box_m")
    slack = 1e-6 * (1.0 + float(np.abs(ring).max()))
    if (ring.min(axis=0) < np.array(box[:2]) - slack).any() or (ring.max(axis=0) > np.array(box[3:5]) + slack).any():
        raise InputError(f"footprint_m reaches out of box_m={box}")
    outline = shapely.Polygon(ring)
    if not outline.is_valid or not outline.area > 0.0:
        raise InputError(f"footprint_m: {shapely.is_valid_reason(outline)}, expected an outline that holds an area")


def _prepared(parcel: Parcel) -> _Ready:
    """Check a parcel and compute what goes with it, before anything is written."""
    sha256 = _checked(parcel.header, parcel.payload, parcel.names, parcel.type_name, parcel.codec)
    header = replace(parcel.header, sha256=sha256)
    poses = _poses_of(parcel.type_name, parcel.payload, parcel.codec, parcel.value)
    ring = footprint_of(header, parcel.value)
    return _Ready(parcel, header, chunk_sums(parcel.payload), poses, None if ring is None else ring_bytes(ring))


def _poses_of(type_name: str, payload: bytes, codec: str, value: Any) -> list[tuple[int, Any]] | None:
    if type_name not in _POSES or not payload:
        return None
    from cdff_common.codecs import decode  # the grammars are compiled on import: not at the store's start

    decoded = decode(type_name, payload, codec) if value is None else value
    return [(int(decoded.stamp_ns), decoded.transform)]

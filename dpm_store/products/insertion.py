# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Insertion of products: checks, durable payloads, then the rows of all products of a batch in one
transaction.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import msgpack
import numpy as np
from sqlalchemy import Connection, Select, func, insert, select, update

from cdff_common.clock import NS_PER_S, Clock
from cdff_common.codecs import CODECS
from cdff_common.contract.limits import LATEST_NS
from cdff_common.contract.names import KEY_NAME
from cdff_common.errors import CodecError, ConflictError, InputError
from cdff_common.interfaces.product import Header
from dpm_store.engine import schema
from dpm_store.engine.database import DIALECTS, add_to_tallies, dialect_of
from dpm_store.engine.dialect import IndexEntry
from dpm_store.frames.poses import PoseTable
from dpm_store.history.events import EventTable
from dpm_store.payloads.blobs import chunk_sums, digest
from dpm_store.payloads.payloads import PACKED_BYTES, Content, Payloads
from dpm_store.products.pose_graphs import TYPE_NAME, Rows, rows_of
from dpm_store.products.records import Insertion, NewProduct
from dpm_store.search.footprints import footprint_of, ring_bytes

MAX_PAYLOAD_BYTES = 1 << 30
#: Largest coordinate of a box, metres (several astronomical units), so that the index remains precise.
FARTHEST_BOX_M = 1e12
#: Metrics with longer names cannot be searched.
MAX_METRIC_NAME = 64
#: Type whose payloads are also entered in the pose series.
_POSE = "TransformWithCovariance"
_NAME = re.compile(rf"{KEY_NAME}\Z")
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_\-]{0,63}\Z")
_EPOCH = "epoch_ns"
_p, _n, _i = schema.products.c, schema.frame_names.c, schema.index_buckets.c
_LAST_ORDINAL = select(func.max(_p.ordinal))
_EPOCH_VALUE = select(schema.meta.c.value).where(schema.meta.c.name == _EPOCH)
#: Columns that are equal for equal products, apart from the header.
_CONTENT_COLUMNS = ("robot", "dfpc", "port", "product", "type_name", "codec", "size")
_HEADER_COLUMNS = ("id", "frame", "child", "config_hash", "t0_ns", "t1_ns", "resolution_m", "sha256")


@dataclass(frozen=True, slots=True)
class PreparedProduct:
    """A product that passed the checks; the header has the digest of the payload."""

    product: NewProduct
    header: Header
    chunk_sums: bytes
    poses: list[tuple[int, Any]] | None
    ring: bytes | None = None
    graph: Rows | None = None

    @property
    def is_packed(self) -> bool:
        """True if the payload is stored in a pack."""
        return len(self.product.payload) <= PACKED_BYTES

    def row(self, ordinal: int, inserted_ns: int) -> dict[str, Any]:
        """Return the row of ``products``."""
        header, product = self.header, self.product
        return {
            "ordinal": ordinal,
            **product.names,
            "type_name": product.type_name,
            "codec": product.codec,
            **{name: getattr(header, name) for name in _HEADER_COLUMNS},
            "status": str(header.quality.status),
            "covariance_kind": str(header.quality.covariance_kind),
            "header": msgpack.packb(header.to_dict()),
            "size": len(product.payload),
            "inserted_ns": inserted_ns,
            **dict(zip(schema.SIDES, header.box_m or (None,) * 6, strict=True)),
        }


class Inserter:
    """Inserts the rows and payloads of products."""

    def __init__(self, payloads: Payloads, events: EventTable, clock: Clock) -> None:
        self._payloads = payloads
        self._events = events
        self._clock = clock

    def insert_in(self, connection: Connection, prepared: Sequence[PreparedProduct]) -> list[Insertion]:
        """Insert products whose payload files are written, inside a transaction.

        Raises
        ------
        ConflictError
            If an id exists with other content, or was deleted.
        """
        stored = stored_products(connection, prepared)
        new = [item for item in prepared if item.header.id not in stored]
        if new:
            self._insert(connection, new)
        return [Insertion.ALREADY if item.header.id in stored else Insertion.INSERTED for item in prepared]

    def write_files(self, prepared: Iterable[PreparedProduct]) -> None:
        """Make durable the payloads that are stored in files."""
        for item in prepared:
            if not item.is_packed:
                self._payloads.files.write(item.header.sha256 or "", item.product.payload, item.chunk_sums)

    def _insert(self, connection: Connection, new: Sequence[PreparedProduct]) -> None:
        now_ns = self._clock.now_ns()
        self.insert_rows(connection, new, now_ns)
        bodies = [(item.product.robot, event_body(item.header, item.product.names)) for item in new]
        self._events.append_all_in(connection, "inserted", bodies)
        self._payloads.packs.flush()

    def insert_rows(self, connection: Connection, new: Sequence[PreparedProduct], now_ns: int) -> None:
        """Insert products without events; small payloads are durable after ``packs.flush``."""
        first = _next_ordinal(connection)
        numbered = list(enumerate(new, first))
        contents = {item.header.sha256 or "": Content(item.product.payload, item.chunk_sums) for item in new}
        self._payloads.insert(connection, contents, Counter(item.header.sha256 or "" for item in new))
        add = dialect_of(connection).insert_rows
        add(connection, schema.products, [item.row(ordinal, now_ns) for ordinal, item in numbered])
        sizes = (((i.product.robot, i.product.product), len(i.product.payload)) for i in new)
        add_to_tallies(connection, schema.tallies, sizes)
        _index(connection, numbered)
        add(
            connection,
            schema.footprints,
            [{"ordinal": o, "ring": item.ring} for o, item in numbered if item.ring],
        )
        add(
            connection,
            schema.product_metrics,
            [row for o, item in numbered for row in _metrics(o, item.header)],
        )
        add(connection, schema.provenance, [row for item in new for row in _links(item.header)])
        for nodes, edges in (item.graph for item in new if item.graph is not None):
            add(connection, schema.pose_graph_nodes, nodes)
            add(connection, schema.pose_graph_edges, edges)
        for item in new:
            header, product = item.header, item.product
            if item.poses is not None and header.child is not None:
                PoseTable.add_in(
                    connection,
                    product.robot,
                    f"{product.dfpc}/{product.port}",
                    item.poses,
                    parent=header.frame,
                    child=header.child,
                    product_id=header.id,
                    inserted_ns=now_ns,
                )

    def insert_tombstone(
        self, connection: Connection, product: NewProduct, size: int, inserted_ns: int
    ) -> None:
        """Insert the row of a product whose payload no longer exists, as deleted."""
        item = PreparedProduct(product, product.header, b"", None)
        ordinal = _next_ordinal(connection)
        row = item.row(ordinal, inserted_ns) | {"size": size, "sha256": None, "deleted_ns": inserted_ns}
        connection.execute(insert(schema.products), row)
        _index(connection, [(ordinal, item)])
        dialect_of(connection).index_deleted(connection, ordinal)
        dialect_of(connection).insert_rows(connection, schema.provenance, _links(item.header))


def stored_products(connection: Connection, prepared: Sequence[PreparedProduct]) -> set[str]:
    """Return the ids that are stored with the same content.

    Raises
    ------
    ConflictError
        If an id exists with other content, or was deleted.
    """
    dialect, stored = dialect_of(connection), set()
    items = {item.header.id: item for item in prepared}
    values = {"ids": dialect.list_value(list(items))}
    for product_id, deleted_ns, header, *content in dialect.fetch(
        connection, _known_payload(connection.dialect.name), values
    ):
        if deleted_ns is not None:
            raise ConflictError(f"product {product_id} was deleted; its id cannot be used again")
        item = items[product_id]
        expected = {
            **item.product.names,
            "type_name": item.product.type_name,
            "codec": item.product.codec,
            "size": len(item.product.payload),
        }
        is_same = content == [expected[name] for name in _CONTENT_COLUMNS]
        if not is_same or Header.from_dict(msgpack.unpackb(header)) != item.header:
            raise ConflictError(
                f"product {product_id} exists with other content; a new result needs a new id"
            )
        stored.add(product_id)
    return stored


@cache
def _known_payload(engine: str) -> Select[Any]:
    columns = (_p[name] for name in ("id", "deleted_ns", "header", *_CONTENT_COLUMNS))
    return select(*columns).where(_p.id.in_(DIALECTS[engine].elements("ids")))


@cache
def _frame_rows(engine: str) -> Select[Any]:
    return select(_n.ordinal, _n.frame, _n.zmin_m, _n.zmax_m).where(
        _n.frame.in_(DIALECTS[engine].elements("frames"))
    )


@cache
def _bucket_rows(engine: str) -> Select[Any]:
    return select(_i.frame, _i.product, _i.ordinal).where(
        _i.frame.in_(DIALECTS[engine].elements("frames", int))
    )


def _next_ordinal(connection: Connection) -> int:
    ((last,),) = dialect_of(connection).fetch(connection, _LAST_ORDINAL)
    return (last or 0) + 1


def epoch_ns(connection: Connection) -> int | None:
    """Return the origin of the times in the index, nanoseconds; None before the first product."""
    rows = dialect_of(connection).fetch(connection, _EPOCH_VALUE)
    return int(rows[0][0]) if rows else None


def _index(connection: Connection, numbered: Sequence[tuple[int, PreparedProduct]]) -> None:
    """Enter the frames, heights and boxes of new products in the search indexes."""
    dialect = dialect_of(connection)
    frames = sorted({item.header.frame for _, item in numbered})
    dialect.upsert_rows(connection, schema.frame_names, [{"frame": frame} for frame in frames])
    ordinals = {}
    values = {"frames": dialect.list_value(frames)}
    for ordinal, frame, zmin_m, zmax_m in dialect.fetch(
        connection, _frame_rows(connection.dialect.name), values
    ):
        ordinals[frame] = ordinal
        boxes_m = [item.header.box_m for _, item in numbered if item.header.frame == frame]
        _extend_heights(connection, ordinal, () if zmin_m is None else (zmin_m, zmax_m), boxes_m)
    epoch = epoch_ns(connection)
    if epoch is None:
        epoch = numbered[0][1].header.t0_ns
        connection.execute(insert(schema.meta), {"name": _EPOCH, "value": str(epoch)})
    buckets = _buckets(
        connection, {(ordinals[item.header.frame], item.product.product) for _, item in numbered}
    )
    entries: list[IndexEntry] = []
    for ordinal, item in numbered:
        header = item.header
        if header.box_m is not None:
            span_s = ((header.t0_ns - epoch) / NS_PER_S, (header.t1_ns - epoch) / NS_PER_S)
            bucket = buckets[ordinals[header.frame], item.product.product]
            entries.append((ordinal, (bucket, header.box_m), span_s))
    if entries:
        dialect.index_products(connection, entries)


def _buckets(connection: Connection, keys: set[tuple[int, str]]) -> dict[tuple[int, str], int]:
    """Return the ordinals of the index buckets of frames and types; missing ones are created."""
    dialect = dialect_of(connection)
    rows = [{"frame": frame, "product": product} for frame, product in sorted(keys)]
    dialect.upsert_rows(connection, schema.index_buckets, rows)
    values = {"frames": dialect.list_value(sorted({frame for frame, _ in keys}))}
    bucket_rows = dialect.fetch(connection, _bucket_rows(connection.dialect.name), values)
    return {(frame, product): ordinal for frame, product, ordinal in bucket_rows}


def _extend_heights(
    connection: Connection,
    frame: int,
    current: tuple[float, ...],
    boxes_m: Sequence[tuple[float, ...] | None],
) -> None:
    """Extend the stored range of heights of a frame, given by its ordinal, to contain more boxes."""
    heights = [*current, *(box[i] for box in boxes_m if box is not None for i in (2, 5))]
    if heights and current != (span := (min(heights), max(heights))):
        extended = {"zmin_m": span[0], "zmax_m": span[1]}
        connection.execute(update(schema.frame_names).where(_n.ordinal == frame).values(extended))


def _metrics(ordinal: int, header: Header) -> list[dict[str, Any]]:
    return [
        {"ordinal": ordinal, "name": name, "value": value}
        for name, value in header.quality.metrics.items()
        if len(name) <= MAX_METRIC_NAME and math.isfinite(value)
    ]


def _links(header: Header) -> list[dict[str, Any]]:
    return [{"product_id": header.id, "input_id": i} for i in dict.fromkeys(header.inputs)]


def event_body(header: Header, names: dict[str, str]) -> dict[str, Any]:
    """Return the body of an event about a product."""
    body: dict[str, Any] = {
        "id": header.id,
        **names,
        "frame": header.frame,
        "t0_ns": header.t0_ns,
        "t1_ns": header.t1_ns,
        "status": str(header.quality.status),
    }
    return body if header.box_m is None else body | {"box_m": list(header.box_m)}


def prepare(product: NewProduct) -> PreparedProduct:
    """Check a product and compute its digest, sums, poses and footprint; raises like ``put_all``."""
    sha256 = _check_product(product.header, product.payload, product.names, product.type_name, product.codec)
    header = replace(product.header, sha256=sha256)
    value = _needed_value(product)
    poses = (
        [(int(value.stamp_ns), value.transform)] if value is not None and product.type_name == _POSE else None
    )
    graph = rows_of(header.id, value) if value is not None and product.type_name == TYPE_NAME else None
    ring = footprint_of(header, product.value)
    return PreparedProduct(
        product, header, chunk_sums(product.payload), poses, None if ring is None else ring_bytes(ring), graph
    )


def _check_product(header: Header, payload: bytes, names: dict[str, str], type_name: str, codec: str) -> str:
    """Return the SHA-256 of the payload; raises InputError or CodecError for a product that is not valid."""
    for field, name in names.items():
        if not _NAME.match(name):
            raise InputError(f"{field}={name[:80]!r}: expected lower case letters, digits and _, at most 64")
    if not _TYPE.match(type_name):
        raise InputError(f"type {type_name[:80]!r}: expected the name of an ASN.1 type")
    if codec not in CODECS:
        raise InputError(f"codec {codec[:80]!r}: expected one of {', '.join(CODECS)}")
    if len(payload) > MAX_PAYLOAD_BYTES:
        raise InputError(f"payload of {len(payload)} bytes: expected at most {MAX_PAYLOAD_BYTES}")
    if max(abs(header.t0_ns), abs(header.t1_ns)) > LATEST_NS or not 0 <= header.seq <= LATEST_NS:
        raise InputError(f"capture {header.t0_ns}..{header.t1_ns}, seq {header.seq}: out of range")
    box = header.box_m
    if box is not None and (
        not all(math.isfinite(v) for v in box) or any(box[i] > box[i + 3] for i in range(3))
    ):
        raise InputError(f"box_m={box}: expected finite metres, each minimum at or below its maximum")
    if box is not None and max(map(abs, box)) > FARTHEST_BOX_M:
        raise InputError(f"box_m={box}: expected within {FARTHEST_BOX_M:g} m of the frame's origin")
    _check_footprint(header)
    sha256 = digest(payload)
    if header.sha256 not in (None, sha256):
        raise CodecError(f"product {header.id}: payload has SHA-256 {sha256}, its header {header.sha256}")
    return sha256


def _check_footprint(header: Header) -> None:
    """Raise InputError if a footprint has no box, is not finite, leaves the box, or intersects itself."""
    if header.footprint_m is None:
        return
    import shapely

    ring, box = np.array(header.footprint_m).reshape(-1, 2), header.box_m
    if box is None or not np.isfinite(ring).all():
        raise InputError("footprint_m: expected finite metres, together with a box_m")
    margin = 1e-6 * (1.0 + float(np.abs(ring).max()))
    if (ring.min(axis=0) < np.array(box[:2]) - margin).any() or (
        ring.max(axis=0) > np.array(box[3:5]) + margin
    ).any():
        raise InputError(f"footprint_m reaches outside of box_m={box}")
    outline = shapely.Polygon(ring)
    if not outline.is_valid or not outline.area > 0.0:
        raise InputError(f"footprint_m: {shapely.is_valid_reason(outline)}, expected an outline with an area")


def _needed_value(product: NewProduct) -> Any:
    """Return the decoded payload of poses and pose graphs, which also have their own tables; else None."""
    if product.type_name not in (_POSE, TYPE_NAME) or not product.payload:
        return None
    from cdff_common.codecs import decode  # importing it compiles the grammars

    return (
        decode(product.type_name, product.payload, product.codec) if product.value is None else product.value
    )

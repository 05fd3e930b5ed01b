# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Products on their way in: checked, their payloads made durable, then all rows of many in one transaction."""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import msgpack
import numpy as np
from sqlalchemy import Connection, Row, func, insert, select, update

from cdff_common.clock import NS_PER_S, Clock
from cdff_common.errors import CodecError, ConflictError, InputError
from cdff_common.interfaces.product import Header
from dpm_store import schema, sqlite
from dpm_store.blobs import chunk_sums, digest
from dpm_store.events import EventTable
from dpm_store.footprints import footprint_of, ring_bytes
from dpm_store.payloads import PACKED_BYTES, Content, Payloads
from dpm_store.pose_graphs import TYPE_NAME, Rows, rows_of
from dpm_store.poses import PoseTable
from dpm_store.records import LATEST_NS, Insertion, Parcel

MAX_PAYLOAD_BYTES = 1 << 30
#: Corners of a box farther out, some astronomical units, could neither be indexed nor brought into another frame.
FARTHEST_BOX_M = 1e12
#: Of a number in the quality, to be found by.
MAX_METRIC_NAME = 64
#: Products whose payload is also entered in the pose series.
_POSE = "TransformWithCovariance"
_NAME = re.compile(r"[a-z0-9_]{1,64}\Z")
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_\-]{0,63}\Z")
_CODECS = ("uper", "ber", "xer", "msgpack")
_EPOCH = "epoch_ns"
#: Ids looked up by one statement.
_TOGETHER = 500


@dataclass(frozen=True, slots=True)
class Ready:
    """A parcel that was checked; the header has its digest."""

    parcel: Parcel
    header: Header
    chunk_sums: bytes
    poses: list[tuple[int, Any]] | None
    ring: bytes | None = None
    graph: Rows | None = None

    @property
    def is_packed(self) -> bool:
        """Tell whether the payload goes into a pack."""
        return len(self.parcel.payload) <= PACKED_BYTES

    def row(self, ordinal: int, inserted_ns: int) -> dict[str, Any]:
        """Of ``products``."""
        header, parcel = self.header, self.parcel
        box = header.box_m or (None,) * 6
        return {
            "ordinal": ordinal, **parcel.names, "id": header.id, "type_name": parcel.type_name, "codec": parcel.codec,
            "frame": header.frame, "child": header.child, "config_hash": header.config_hash, "t0_ns": header.t0_ns,
            "t1_ns": header.t1_ns, "resolution_m": header.resolution_m, "status": str(header.quality.status),
            "covariance_kind": str(header.quality.covariance_kind), "header": msgpack.packb(header.to_dict()),
            "sha256": header.sha256, "size": len(parcel.payload), "inserted_ns": inserted_ns, "xmin_m": box[0],
            "ymin_m": box[1], "zmin_m": box[2], "xmax_m": box[3], "ymax_m": box[4], "zmax_m": box[5],
        }  # fmt: skip


class Inserter:
    """Enters products with all that goes with them."""

    def __init__(self, payloads: Payloads, events: EventTable, clock: Clock) -> None:
        self._payloads = payloads
        self._events = events
        self._clock = clock

    def insert_in(self, connection: Connection, ready: Sequence[Ready]) -> list[Insertion]:
        """Enter products whose payload files are written, inside a transaction.

        Raises
        ------
        ConflictError
            If an id is there with other content, or was deleted.
        """
        known = compare(connection, ready)
        new = [item for item in ready if item.header.id not in known]
        if new:
            self._enter(connection, new)
        return [known.get(item.header.id, Insertion.INSERTED) for item in ready]

    def write_files(self, ready: Iterable[Ready]) -> None:
        """Make the payloads durable that go into files."""
        for item in ready:
            if not item.is_packed:
                self._payloads.files.write(item.header.sha256 or "", item.parcel.payload)

    def _enter(self, connection: Connection, new: Sequence[Ready]) -> None:
        now_ns = self._clock.now_ns()
        first: int = (connection.execute(select(func.max(schema.products.c.ordinal))).scalar() or 0) + 1
        numbered = list(enumerate(new, first))
        contents = {item.header.sha256 or "": Content(item.parcel.payload, item.chunk_sums) for item in new}
        self._payloads.enter(connection, contents, Counter(item.header.sha256 or "" for item in new))
        add = sqlite.insert_rows
        add(connection, schema.products, [item.row(ordinal, now_ns) for ordinal, item in numbered])
        sizes = ((item.parcel.robot, item.parcel.product, len(item.parcel.payload)) for item in new)
        sqlite.count_products(connection, sizes)
        _index(connection, numbered)
        add(connection, schema.footprints, [{"ordinal": o, "ring": item.ring} for o, item in numbered if item.ring])
        add(connection, schema.product_metrics, [row for o, item in numbered for row in _metrics(o, item.header)])
        add(connection, schema.provenance, [row for item in new for row in _links(item.header)])
        for nodes, edges in (item.graph for item in new if item.graph is not None):
            add(connection, schema.pose_graph_nodes, nodes)
            add(connection, schema.pose_graph_edges, edges)
        for item in new:
            header, parcel = item.header, item.parcel
            if item.poses is not None and header.child is not None:
                PoseTable.add_in(
                    connection, parcel.robot, f"{parcel.dfpc}/{parcel.port}", item.poses, parent=header.frame,
                    child=header.child, product_id=header.id, inserted_ns=now_ns,
                )  # fmt: skip
        bodies = [(item.parcel.robot, event_body(item.header, item.parcel.names)) for item in new]
        self._events.append_all_in(connection, "inserted", bodies)
        self._payloads.settle()


def compare(connection: Connection, ready: Sequence[Ready]) -> dict[str, Insertion]:
    """Ids of those that are there with the same content; raises ConflictError for one that has other content."""
    p, found = schema.products.c, {}
    columns = (p.id, p.deleted_ns, p.robot, p.dfpc, p.port, p.product, p.type_name, p.codec, p.size, p.header)
    for start in range(0, len(ready), _TOGETHER):
        part = {item.header.id: item for item in ready[start : start + _TOGETHER]}
        for row in connection.execute(select(*columns).where(p.id.in_(part))):
            if row.deleted_ns is not None:
                raise ConflictError(f"product {row.id} was deleted; its id is not free again")
            item, there = part[row.id], row._mapping
            wanted = {
                **item.parcel.names, "type_name": item.parcel.type_name, "codec": item.parcel.codec,
                "size": len(item.parcel.payload),
            }  # fmt: skip
            same = all(there[name] == value for name, value in wanted.items())
            if not same or Header.from_dict(msgpack.unpackb(row.header)) != item.header:
                raise ConflictError(f"product {row.id} is there with other content; a new result needs a new id")
            found[row.id] = Insertion.ALREADY
    return found


def epoch_ns(connection: Connection) -> int | None:
    """Time that index times are counted from; None before the first product."""
    value = connection.execute(select(schema.meta.c.value).where(schema.meta.c.name == _EPOCH)).scalar()
    return None if value is None else int(value)


def _index(connection: Connection, numbered: Sequence[tuple[int, Ready]]) -> None:
    n, frames = schema.frame_names.c, {item.header.frame for _, item in numbered}
    connection.execute(sqlite.insert_new(schema.frame_names), [{"frame": frame} for frame in sorted(frames)])
    named = connection.execute(select(schema.frame_names).where(n.frame.in_(frames))).all()
    ordinals = {row.frame: row.ordinal for row in named}
    for row in named:
        _widen(connection, row, [item.header.box_m for _, item in numbered if item.header.frame == row.frame])
    epoch = epoch_ns(connection)
    if epoch is None:
        epoch = numbered[0][1].header.t0_ns
        connection.execute(insert(schema.meta), {"name": _EPOCH, "value": str(epoch)})
    buckets = _buckets(connection, {(ordinals[item.header.frame], item.parcel.product) for _, item in numbered})
    entries = []
    for ordinal, item in numbered:
        header = item.header
        if header.box_m is not None:
            span_s = ((header.t0_ns - epoch) / NS_PER_S, (header.t1_ns - epoch) / NS_PER_S)
            bucket = buckets[ordinals[header.frame], item.parcel.product]
            entries.append((ordinal, (bucket, header.box_m), span_s))
    if entries:
        sqlite.index_products(connection, entries)


def _buckets(connection: Connection, wanted: set[tuple[int, str]]) -> dict[tuple[int, str], int]:
    """Ordinals of what the index calls a frame and a type together; new ones are made."""
    b = schema.index_buckets.c
    rows = [{"frame": frame, "product": product} for frame, product in sorted(wanted)]
    connection.execute(sqlite.insert_new(schema.index_buckets), rows)
    found = connection.execute(select(schema.index_buckets).where(b.frame.in_({frame for frame, _ in wanted})))
    return {(row.frame, row.product): row.ordinal for row in found}


def _widen(connection: Connection, frame: Row[Any], boxes_m: Sequence[tuple[float, ...] | None]) -> None:
    """Let the heights of a frame hold those of more boxes."""
    known = () if frame.zmin_m is None else (frame.zmin_m, frame.zmax_m)
    heights = [*known, *(box[i] for box in boxes_m if box is not None for i in (2, 5))]
    if heights and known != (span := (min(heights), max(heights))):
        ordinal = schema.frame_names.c.ordinal
        grown = {"zmin_m": span[0], "zmax_m": span[1]}
        connection.execute(update(schema.frame_names).where(ordinal == frame.ordinal).values(grown))


def _metrics(ordinal: int, header: Header) -> list[dict[str, Any]]:
    return [
        {"ordinal": ordinal, "name": name, "value": value}
        for name, value in header.quality.metrics.items()
        if len(name) <= MAX_METRIC_NAME and math.isfinite(value)
    ]


def _links(header: Header) -> list[dict[str, Any]]:
    return [{"product_id": header.id, "input_id": i} for i in dict.fromkeys(header.inputs)]


def event_body(header: Header, names: dict[str, str]) -> dict[str, Any]:
    """What an event says of a product."""
    body: dict[str, Any] = {
        "id": header.id, **names, "frame": header.frame, "t0_ns": header.t0_ns, "t1_ns": header.t1_ns,
        "status": str(header.quality.status),
    }  # fmt: skip
    return body if header.box_m is None else body | {"box_m": list(header.box_m)}


def prepared(parcel: Parcel) -> Ready:
    """Check a parcel and compute what goes with it, before anything is written; raises as ``ProductTable.put``."""
    sha256 = _checked(parcel.header, parcel.payload, parcel.names, parcel.type_name, parcel.codec)
    header = replace(parcel.header, sha256=sha256)
    value = _needed_value(parcel)
    poses = [(int(value.stamp_ns), value.transform)] if value is not None and parcel.type_name == _POSE else None
    graph = rows_of(header.id, value) if value is not None and parcel.type_name == TYPE_NAME else None
    ring = footprint_of(header, parcel.value)
    return Ready(parcel, header, chunk_sums(parcel.payload), poses, None if ring is None else ring_bytes(ring), graph)


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
    if box is not None and max(map(abs, box)) > FARTHEST_BOX_M:
        raise InputError(f"box_m={box}: expected within {FARTHEST_BOX_M:g} m of the frame's origin")
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


def _needed_value(parcel: Parcel) -> Any:
    """The decoded payload of what is kept in more than its bytes, poses and pose graphs; else None."""
    if parcel.type_name not in (_POSE, TYPE_NAME) or not parcel.payload:
        return None
    from cdff_common.codecs import decode  # the grammars are compiled on import: not at the store's start

    return decode(parcel.type_name, parcel.payload, parcel.codec) if parcel.value is None else parcel.value

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Packets between a robot and the ground: MessagePack arrays whose first element is the kind.

Down (from the robot): ``HELLO epoch store_id backlog now_ns oldest``, ``DATA epoch seq key total offset
bytes``, ``TAKEN id``, ``RESULT id result``. Up: ``WELCOME epoch parts``,
``ACK epoch low high missing done wanted``, ``REQUEST id body expires_ns``, ``NOTED id``, ``FIRST ids``.

An *item* is a sequence of bytes with a key: the record of a product, the payload of a product, or a bundle of
events. Its number is the ordinal of an event of the robot's store.
"""

from __future__ import annotations

import itertools
import zlib
from enum import IntEnum
from typing import Any

import msgpack

from cdff_common.errors import CodecError
from dpm_store import Event, NewProduct, ProductRecord
from dpm_store.exchange.ledger import Ranges

#: Largest number of item bytes in a packet, so that it fits in a datagram of 1280 bytes, the least of IPv6.
CHUNK_BYTES = 1100
#: Bytes of the frame that Zenoh adds to a packet.
FRAME_BYTES = 16
#: Payloads up to this size are part of the record.
INLINE_BYTES = 4096
#: Ranges in one packet.
MAX_RANGES = 60


class Kind(IntEnum):
    """First element of a packet."""

    HELLO = 0
    WELCOME = 1
    DATA = 2
    ACK = 3
    REQUEST = 4
    TAKEN = 5
    RESULT = 6
    NOTED = 7
    FIRST = 8


class Item(IntEnum):
    """Kind of an item: its key is ``3 * ordinal + kind``."""

    RECORD = 0
    PAYLOAD = 1
    EVENTS = 2

    def key(self, ordinal: int) -> int:
        """Return the key of an item."""
        return 3 * ordinal + self


def item_of(key: int) -> tuple[Item, int]:
    """Return the kind and the ordinal of a key."""
    return Item(key % 3), key // 3


def pack(kind: Kind, *fields: object) -> bytes:
    """Return a packet."""
    data: bytes = msgpack.packb([int(kind), *fields])
    return data


def unpack(data: bytes) -> tuple[Kind, list[Any]]:
    """Return kind and fields of a packet; raises CodecError for other bytes."""
    try:
        kind, *fields = msgpack.unpackb(data)
        return Kind(kind), fields
    except Exception as error:  # msgpack raises many types for malformed bytes
        raise CodecError(f"packet of {len(data)} bytes cannot be read: {error}") from error


#: Texts that most records have, which the compression then replaces by references.
_DICTIONARY = (
    b"\xa6status\xa2OK\xa7reasons\x90\xafcovariance_kind\xaauncalibrated\xa7metrics\x80"
    b"calibrated none DEGRADED"
    b"planetary "
    b"TransformWithCovariance ElevationMap Pointcloud uper pose dem pointcloud image /base /odom site "
    b"\x8c\xa2id\xd9$\xa3seq\xa5t0_ns\xa5t1_ns\xa5frame\xa5child\xa8producer\xabconfig_hash\xa6inputs"
    b"\xa7quality\xa5box_m\xacresolution_m\xa6sha256\xd9@"
)


def _compress(fields: Any) -> bytes:
    packer = zlib.compressobj(9, zlib.DEFLATED, -15, zdict=_DICTIONARY)
    return packer.compress(msgpack.packb(fields)) + packer.flush()


def _decompress(data: bytes) -> Any:
    unpacker = zlib.decompressobj(-15, zdict=_DICTIONARY)
    try:
        return msgpack.unpackb(unpacker.decompress(data, 1 << 24))
    except Exception as error:  # zlib and msgpack raise many types for malformed bytes
        raise CodecError(f"item of {len(data)} bytes cannot be read: {error}") from error


def pack_record(record: ProductRecord, priority: int, payload: bytes | None) -> bytes:
    """Return the record of a product, with its payload if that is given."""
    names = [record.robot, record.dfpc, record.port, record.product, record.type_name, record.codec]
    return _compress([names, record.packed_header, record.size, priority, payload])


class ReceivedRecord:
    """Record of a product from a robot.

    Attributes
    ----------
    names : dict of str to str
        robot, dfpc, port, product, type_name and codec.
    fields : dict
        The header as plain data.
    size : int
        Bytes of the payload.
    priority : int
    payload : bytes or None
        The payload if it is small.
    """

    def __init__(self, data: bytes) -> None:
        try:
            names, header, self.size, self.priority, self.payload = _decompress(data)
            self.names: dict[str, str] = dict(
                zip(("robot", "dfpc", "port", "product", "type_name", "codec"), names, strict=True)
            )
            self.fields: dict[str, Any] = msgpack.unpackb(header)
            self.id, self.sha256 = str(self.fields["id"]), str(self.fields["sha256"])
        except (KeyError, TypeError, ValueError) as error:
            raise CodecError(f"record of {len(data)} bytes: {error!r}") from error

    def product(self, payload: bytes) -> NewProduct:
        """Return the product with its payload."""
        from cdff_common.interfaces.product import Header

        return NewProduct(Header.from_dict(self.fields), payload, **self.names)


def pack_events(events: list[Event], revisions: list[dict[str, Any]]) -> bytes:
    """Return a bundle of events and of the frame revisions that they name."""
    return _compress([[[e.ordinal, e.stamp_ns, e.scope, e.kind, e.body] for e in events], revisions])


def unpack_events(data: bytes) -> tuple[list[Event], list[dict[str, Any]]]:
    """Return the events and the frame revisions of a bundle; raises CodecError."""
    try:
        events, revisions = _decompress(data)
        return [Event(*fields) for fields in events], revisions
    except (TypeError, ValueError) as error:
        raise CodecError(f"bundle of {len(data)} bytes: {error!r}") from error


def add_range(ranges: Ranges, first: int, end: int) -> None:
    """Add an interval to intervals in order."""
    kept = [r for r in ranges if r[1] < first or r[0] > end]
    touching = [r for r in ranges if not (r[1] < first or r[0] > end)]
    merged = (min([first, *(r[0] for r in touching)]), max([end, *(r[1] for r in touching)]))
    ranges[:] = sorted([*kept, merged])


def missing_ranges(ranges: Ranges, total: int) -> Ranges:
    """Return the intervals of ``0 … total`` that are not in ``ranges``."""
    edges = [(0, 0), *ranges, (total, total)]
    return [(a[1], b[0]) for a, b in itertools.pairwise(edges) if a[1] < b[0]]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What goes into the store and comes out: products' metadata, searches, pages."""

from __future__ import annotations

import base64
import binascii
import math
import struct
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import Any, NamedTuple

import msgpack

from cdff_common.errors import InputError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header

MAX_LIMIT = 1000
#: Times beyond this are refused: a 64-bit column must hold them and their differences.
LATEST_NS = 1 << 62
_CURSOR = struct.Struct(">cdqqqq")


class Insertion(StrEnum):
    """What an insertion came to."""

    INSERTED = "inserted"
    ALREADY = "already"


@dataclass(frozen=True, slots=True)
class Parcel:
    """A product on its way in: what ``Store.put`` takes."""

    header: Header
    payload: bytes
    robot: str
    dfpc: str
    port: str
    product: str
    type_name: str
    codec: str = "uper"
    value: Any = None

    @property
    def names(self) -> dict[str, str]:
        """The parts of its key, and what it is to a requester."""
        return {"robot": self.robot, "dfpc": self.dfpc, "port": self.port, "product": self.product}


class _Columns(NamedTuple):
    ordinal: int
    robot: str
    dfpc: str
    port: str
    product: str
    type_name: str
    codec: str
    id: str
    t1_ns: int
    packed_header: bytes
    size: int
    inserted_ns: int
    deleted_ns: int | None = None


class ProductRecord(_Columns):
    """Metadata of a stored product. Its header is read when it is first asked for.

    Attributes
    ----------
    ordinal : int
        The store's own number, growing with insertion.
    robot, dfpc, port : str
        Where it comes from: the parts of its key.
    product : str
        What it is to a requester: pose, dem, … (contract §5).
    type_name : str
        ASN.1 type of the payload.
    codec : str
        uper, ber, xer or msgpack.
    id : str
        Id of contract §5.
    t1_ns : int
        End of capture.
    packed_header : bytes
        The header as MessagePack.
    size : int
        Of the payload, bytes.
    inserted_ns, deleted_ns : int or None
        Mission time.
    """

    @cached_property
    def header(self) -> Header:
        """As it was inserted, with the payload's ``sha256``."""
        return Header.from_dict(msgpack.unpackb(self.packed_header))

    @property
    def sha256(self) -> str:
        """Digest of the payload."""
        return self.header.sha256 or ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data: the header's fields, and beside them what the key and the store add."""
        data: dict[str, Any] = msgpack.unpackb(self.packed_header)
        data |= {
            "robot": self.robot, "dfpc": self.dfpc, "port": self.port, "product": self.product,
            "type_name": self.type_name, "codec": self.codec, "size": self.size, "inserted_ns": self.inserted_ns,
        }  # fmt: skip
        return data if self.deleted_ns is None else data | {"deleted_ns": self.deleted_ns}


class Order(StrEnum):
    """What comes first."""

    NEWEST = "newest"
    OLDEST = "oldest"
    NEAREST = "nearest"


_LETTERS = {Order.NEWEST: b"n", Order.OLDEST: b"o", Order.NEAREST: b"d"}


@dataclass(frozen=True, slots=True)
class MetricBound:
    """What a number in the quality must be: ``low <= value <= high``, the ends left out where ``strict``."""

    name: str
    low: float = -math.inf
    high: float = math.inf
    strict: bool = False


@dataclass(frozen=True, slots=True)
class Query:
    """A search; every field that is given narrows it.

    Attributes
    ----------
    types : tuple of str
        Products wanted (pose, dem, …); empty for all.
    robot, dfpc, port, status, config_hash : str or None
    t0_ns, t1_ns : int or None
        Capture interval overlaps this one, ends included.
    region : Region or None
        Outline of the product (its footprint, else its box), seen in ``frame``, touches it. Products without a box are
        not found by region.
    frame : str
        Frame of ``region``; products may lie in any frame that a chain of fixed edges joins with it.
    child : str or None
        For poses: the child frame.
    resolution_max_m, resolution_above_m : float or None
        Cells or voxels no larger than the one, and larger than the other.
    inserted_after : int or None
        Ordinal: inserted since.
    tags : tuple of str
        All of these.
    as_of_ns : int or None
        What the store knew at this mission time: products that were there then (also ones deleted since), frames and
        tags as they were then. Poses that went with a deleted product are not.
    frames_revision : int or None
        State of the frame tree to place products by; the newest where it is None (a cursor keeps the one it began by).
    covariance_kind : str or None
    metrics : tuple of MetricBound
        Numbers of the quality that must be there and within bounds, all of them.
    superseded : bool or None
        Only ones with, or without, a successor; None for all.
    order : Order
        Newest or oldest end of capture first, or nearest to ``point``; of equals the newest first.
    point : tuple of 2 float, or None
        For the order ``nearest``: x, y in ``frame``, metres; the region's centre where it is None.
    limit : int
    cursor : str or None
        Of the page before.
    """

    types: tuple[str, ...] = ()
    robot: str | None = None
    dfpc: str | None = None
    port: str | None = None
    status: str | None = None
    config_hash: str | None = None
    t0_ns: int | None = None
    t1_ns: int | None = None
    region: Region | None = None
    frame: str = "site"
    child: str | None = None
    resolution_max_m: float | None = None
    resolution_above_m: float | None = None
    inserted_after: int | None = None
    tags: tuple[str, ...] = ()
    as_of_ns: int | None = None
    superseded: bool | None = None
    frames_revision: int | None = None
    covariance_kind: str | None = None
    metrics: tuple[MetricBound, ...] = ()
    order: Order = Order.NEWEST
    point: tuple[float, float] | None = None
    limit: int = 100
    cursor: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.limit <= MAX_LIMIT:
            raise InputError(f"limit={self.limit}: expected 1 to {MAX_LIMIT}")
        if self.t0_ns is not None and self.t1_ns is not None and self.t0_ns > self.t1_ns:
            raise InputError(f"t0={self.t0_ns} is after t1={self.t1_ns}")
        if self.order is Order.NEAREST and self.point is None and self.region is None:
            raise InputError("order=nearest: to what? Name a point or a region")
        if self.point is not None and (self.order is not Order.NEAREST or not all(map(math.isfinite, self.point))):
            raise InputError(f"point={self.point}: expected finite metres, with order=nearest")


@dataclass(frozen=True, slots=True)
class Page:
    """A page of a search.

    Attributes
    ----------
    items : tuple of ProductRecord
    cursor : str or None
        To ask for the next page; None on the last.
    unplaced_frames : tuple of str
        Frames that hold products but cannot be related to the region's: those products were not looked at.
    frames_revision : int
        State of the frame tree by which products were placed: naming it in a query gives the same places again.
    distances_m : tuple of float
        From the point to each item, where the nearest were asked for.
    """

    items: tuple[ProductRecord, ...]
    cursor: str | None = None
    unplaced_frames: tuple[str, ...] = field(default=())
    frames_revision: int = 0
    distances_m: tuple[float, ...] = ()

    def told(self) -> dict[str, Any]:
        """What goes with the items, as plain data."""
        data: dict[str, Any] = {
            "cursor": self.cursor, "unplaced_frames": list(self.unplaced_frames),
            "frames_revision": self.frames_revision,
        }  # fmt: skip
        return data | {"distances_m": list(self.distances_m)} if self.distances_m else data


@dataclass(frozen=True, slots=True)
class Cursor:
    """The place after a product: it stays valid whatever is inserted, deleted or re-anchored meanwhile.

    Attributes
    ----------
    order : Order
    t1_ns, ordinal : int
        Of the last product before it.
    frames_revision : int
        State of the frame tree that the first page was placed by.
    distance_m : float
        Of the last product, for the order ``nearest``.
    count : int
        How many products come before it, for the order ``nearest``.
    """

    order: Order
    t1_ns: int
    ordinal: int
    frames_revision: int = 0
    distance_m: float = 0.0
    count: int = 0

    @property
    def text(self) -> str:
        """For a client to hand back."""
        packed = _CURSOR.pack(
            _LETTERS[self.order], self.distance_m, self.t1_ns, self.ordinal, self.frames_revision, self.count
        )
        return base64.urlsafe_b64encode(packed).decode().rstrip("=")


def read_cursor(text: str, order: Order) -> Cursor:
    """Inverse of ``Cursor.text``; raises InputError for text that no search gave, or one of another order."""
    try:
        letter, distance_m, t1_ns, ordinal, state, count = _CURSOR.unpack(
            base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        )
    except (binascii.Error, struct.error, ValueError) as error:
        raise InputError(f"cursor={text[:80]!r}: expected the cursor of a page before") from error
    if letter != _LETTERS[order] or not 0.0 <= distance_m < math.inf or min(state, count) < 0 or count > 1 << 40:
        raise InputError(f"cursor={text[:80]!r}: made by a search in another order than {order}")
    return Cursor(order, int(t1_ns), int(ordinal), int(state), float(distance_m), int(count))

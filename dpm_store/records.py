# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What goes into the store and comes out: products' metadata, searches, pages."""

from __future__ import annotations

import base64
import binascii
import struct
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any

from cdff_common.errors import InputError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header

MAX_LIMIT = 1000
#: Times beyond this are refused: a 64-bit column must hold them and their differences.
LATEST_NS = 1 << 62
_CURSOR = struct.Struct(">cqq")


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


@dataclass(frozen=True, slots=True)
class ProductRecord:
    """Metadata of a stored product.

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
    header : Header
        As it was inserted, with the payload's ``sha256``.
    size : int
        Of the payload, bytes.
    inserted_ns, deleted_ns : int or None
        Mission time.
    """

    ordinal: int
    robot: str
    dfpc: str
    port: str
    product: str
    type_name: str
    codec: str
    header: Header
    size: int
    inserted_ns: int
    deleted_ns: int | None = None

    @property
    def id(self) -> str:
        """Id of contract §5."""
        return self.header.id

    @property
    def sha256(self) -> str:
        """Digest of the payload."""
        return self.header.sha256 or ""

    def to_dict(self) -> dict[str, Any]:
        """Plain data: the header's fields, and beside them what the key and the store add."""
        data = self.header.to_dict()
        data |= {
            "robot": self.robot, "dfpc": self.dfpc, "port": self.port, "product": self.product,
            "type_name": self.type_name, "codec": self.codec, "size": self.size, "inserted_ns": self.inserted_ns,
        }  # fmt: skip
        return data if self.deleted_ns is None else data | {"deleted_ns": self.deleted_ns}


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
        Box of the product, seen in ``frame``, touches it. Products without a box are not found by region.
    frame : str
        Frame of ``region``; products may lie in any frame that a chain of fixed edges joins with it.
    child : str or None
        For poses: the child frame.
    resolution_max_m : float or None
        Cells or voxels no larger than this.
    inserted_after : int or None
        Ordinal: inserted since.
    tags : tuple of str
        All of these.
    as_of_ns : int or None
        What the store knew at this mission time: products that were there then (also ones deleted since), frames and
        tags as they were then. Poses that went with a deleted product are not.
    superseded : bool or None
        Only ones with, or without, a successor; None for all.
    oldest_first : bool
        Else newest end of capture first.
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
    inserted_after: int | None = None
    tags: tuple[str, ...] = ()
    as_of_ns: int | None = None
    superseded: bool | None = None
    oldest_first: bool = False
    limit: int = 100
    cursor: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.limit <= MAX_LIMIT:
            raise InputError(f"limit={self.limit}: expected 1 to {MAX_LIMIT}")
        if self.t0_ns is not None and self.t1_ns is not None and self.t0_ns > self.t1_ns:
            raise InputError(f"t0={self.t0_ns} is after t1={self.t1_ns}")


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
    """

    items: tuple[ProductRecord, ...]
    cursor: str | None = None
    unplaced_frames: tuple[str, ...] = field(default=())


def make_cursor(oldest_first: bool, t1_ns: int, ordinal: int) -> str:
    """Text of the place after a product: it stays valid whatever is inserted or deleted meanwhile."""
    return base64.urlsafe_b64encode(_CURSOR.pack(b"o" if oldest_first else b"n", t1_ns, ordinal)).decode().rstrip("=")


def read_cursor(cursor: str, oldest_first: bool) -> tuple[int, int]:
    """Inverse of ``make_cursor``; raises InputError for text that no search gave, or one of the other order."""
    try:
        order, t1_ns, ordinal = _CURSOR.unpack(base64.urlsafe_b64decode(cursor + "=" * (-len(cursor) % 4)))
    except (binascii.Error, struct.error, ValueError) as error:
        raise InputError(f"cursor={cursor[:80]!r}: expected the cursor of a page before") from error
    if (order == b"o") != oldest_first or order not in (b"o", b"n"):
        raise InputError(f"cursor={cursor!r}: made by a search in the other order")
    return int(t1_ns), int(ordinal)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of the interface: new products, metadata of stored ones, queries and pages of results."""

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

from cdff_common.codecs import MAX_EXPANSION
from cdff_common.contract.limits import MAX_PAGE
from cdff_common.contract.metric_bounds import MetricBound as MetricBound
from cdff_common.contract.queries import Order as Order
from cdff_common.errors import InputError
from cdff_common.geometry.region import Region
from cdff_common.interfaces.product import Header

#: Parts of the key of a product, and its kind.
NAMES = ("robot", "dfpc", "port", "product")
_CURSOR = struct.Struct(">cdqqqq")


class Insertion(StrEnum):
    """Outcome of an insertion."""

    INSERTED = "inserted"
    ALREADY = "already"


@dataclass(frozen=True, slots=True)
class NewProduct:
    """A product to insert.

    Attributes
    ----------
    header : Header
        Searches by region use its ``box_m``.
    payload : bytes
        The value of ``type_name`` in ``codec``.
    value : optional
        The decoded payload, if the caller has it: saves decoding poses and gives a footprint.
    """

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
        """Parts of its key, and the kind of product."""
        return {name: getattr(self, name) for name in NAMES}


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


#: Bytes of all layers of a cell, in the maps of the DFPCs.
_CELL_BYTES = {"ElevationMap": 40, "NavigationMap": 24}


class ProductRecord(_Columns):
    """Metadata of a stored product.

    Attributes
    ----------
    ordinal : int
        Number in the order of insertion.
    robot, dfpc, port : str
        Origin: the parts of its key.
    product : str
        Kind of product: pose, dem, …
    type_name : str
        ASN.1 type of the payload.
    codec : str
        uper, ber, xer or msgpack.
    id : str
    t1_ns : int
        End of capture.
    packed_header : bytes
        The header as MessagePack.
    size : int
        Size of the payload, bytes.
    inserted_ns, deleted_ns : int or None
        Mission time.
    """

    @cached_property
    def fields(self) -> dict[str, Any]:
        """The fields of the header as plain data, in a fifth of the time that ``header`` takes."""
        fields: dict[str, Any] = msgpack.unpackb(self.packed_header)
        return fields

    @cached_property
    def header(self) -> Header:
        """The inserted header with the payload's ``sha256``, decoded at the first access."""
        return Header.from_dict(self.fields)

    @property
    def names(self) -> dict[str, str]:
        """Parts of its key, and the kind of product."""
        return {name: getattr(self, name) for name in NAMES}

    @property
    def sha256(self) -> str:
        """Digest of the payload."""
        return str(self.fields.get("sha256") or "")

    @property
    def decoded_bytes(self) -> int:
        """Estimated size of the decoded payload, more than ``size`` for maps of few observed cells."""
        box, resolution_m = self.fields.get("box_m"), self.fields.get("resolution_m")
        cell_bytes = _CELL_BYTES.get(self.type_name, 0)
        if not (cell_bytes and box and resolution_m):
            return self.size
        cells = (box[3] - box[0]) * (box[4] - box[1]) / resolution_m**2
        whole_bytes: int = round(cell_bytes * cells)
        return max(self.size, min(whole_bytes, MAX_EXPANSION * self.size))

    def to_dict(self) -> dict[str, Any]:
        """Return plain data: the fields of the header, of the key and of the store."""
        data = dict(self.fields)
        data |= {name: getattr(self, name) for name in (*NAMES, "type_name", "codec", "size", "inserted_ns")}
        return data if self.deleted_ns is None else data | {"deleted_ns": self.deleted_ns}


_LETTERS = {Order.NEWEST: b"n", Order.OLDEST: b"o", Order.NEAREST: b"d"}


@dataclass(frozen=True, slots=True)
class Query:
    """A search; every field that is set restricts the results.

    Attributes
    ----------
    types : tuple of str
        Kinds of product (pose, dem, …); empty for all.
    robot, dfpc, port, status, config_hash : str or None
    t0_ns, t1_ns : int or None
        Capture interval overlaps this one, ends included.
    region : Region or None
        Region that the outline of the product (its footprint, else its box) touches. Products without a box
        are not found by region.
    frame : str
        Frame of ``region``; products may be in any frame that a chain of fixed edges connects with it.
    child : str or None
        For poses: the child frame.
    resolution_max_m, resolution_above_m : float or None
        Inclusive upper and exclusive lower bound of the cell or voxel size.
    inserted_after : int or None
        Ordinal: only products inserted after it.
    tags : tuple of str
        The product has all of these tags.
    as_of_ns : int or None
        Mission time of the state to search: products stored then (also ones deleted since), frames and tags
        of that time.
    frames_revision : int or None
        State of the frame tree that locates products; None for the newest (a cursor keeps that of its first
        page).
    covariance_kind : str or None
    metrics : tuple of MetricBound
        Metrics of the quality that must exist and be within bounds.
    superseded : bool or None
        Only products with, or without, a successor; None for all.
    where : Call, Among, bool or None
        Expression that holds for the products; see ``dpm_store.search.filters``.
    order : Order
        By end of capture, or by distance from ``point`` and then the newest first.
    sort : tuple of (str, bool)
        Instead of ``order``: columns of products and whether they descend. Regions are not possible.
    point : tuple of 2 float, or None
        For the order ``nearest``: x, y in ``frame``, metres; None for the centre of the region.
    limit : int
    cursor : str or None
        Cursor of the previous page.
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
    where: Any = None
    order: Order = Order.NEWEST
    sort: tuple[tuple[str, bool], ...] = ()
    point: tuple[float, float] | None = None
    limit: int = 100
    cursor: str | None = None

    def __post_init__(self) -> None:
        if not 1 <= self.limit <= MAX_PAGE:
            raise InputError(f"limit={self.limit}: expected 1 to {MAX_PAGE}")
        if self.t0_ns is not None and self.t1_ns is not None and self.t0_ns > self.t1_ns:
            raise InputError(f"t0={self.t0_ns} is after t1={self.t1_ns}")
        if self.order is Order.NEAREST and self.point is None and self.region is None:
            raise InputError("order=nearest: expected a point or a region")
        if self.sort and self.region is not None:
            raise InputError("sort: a search in a region is in the order of time or distance")
        if self.point is not None and (
            self.order is not Order.NEAREST or not all(map(math.isfinite, self.point))
        ):
            raise InputError(f"point={self.point}: expected finite metres, with order=nearest")


@dataclass(frozen=True, slots=True)
class Page:
    """A page of a search.

    Attributes
    ----------
    items : tuple of ProductRecord
    cursor : str or None
        Cursor of the next page; None on the last.
    unplaced_frames : tuple of str
        Frames of products that no fixed edges connect with the region's; those products were not searched.
    frames_revision : int
        State of the frame tree that located the products; a query with it gives the same locations.
    distances_m : tuple of float
        Distance of each item, in the order ``nearest``.
    """

    items: tuple[ProductRecord, ...]
    cursor: str | None = None
    unplaced_frames: tuple[str, ...] = field(default=())
    frames_revision: int = 0
    distances_m: tuple[float, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Return plain data of all fields except the items."""
        data: dict[str, Any] = {
            "cursor": self.cursor,
            "unplaced_frames": list(self.unplaced_frames),
            "frames_revision": self.frames_revision,
        }
        return data | {"distances_m": list(self.distances_m)} if self.distances_m else data


@dataclass(frozen=True, slots=True)
class Cursor:
    """Position after a product; it stays valid when products are inserted, deleted or re-anchored.

    Attributes
    ----------
    order : Order
    t1_ns, ordinal : int
        End of capture and ordinal of the last product before it.
    frames_revision : int
        State of the frame tree of the first page.
    distance_m : float
        Distance of the last product, for the order ``nearest``.
    count : int
        Number of products before it, for the order ``nearest``.
    """

    order: Order
    t1_ns: int
    ordinal: int
    frames_revision: int = 0
    distance_m: float = 0.0
    count: int = 0

    @property
    def text(self) -> str:
        """Encoded form for clients."""
        packed = _CURSOR.pack(
            _LETTERS[self.order], self.distance_m, self.t1_ns, self.ordinal, self.frames_revision, self.count
        )
        return base64.urlsafe_b64encode(packed).decode().rstrip("=")


def read_cursor(text: str, order: Order) -> Cursor:
    """Return the cursor of a text; raises InputError for malformed text or a cursor of another order."""
    try:
        letter, distance_m, t1_ns, ordinal, state, count = _CURSOR.unpack(
            base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))
        )
    except (binascii.Error, struct.error, ValueError) as error:
        raise InputError(f"cursor={text[:80]!r}: expected the cursor of a previous page") from error
    if (
        letter != _LETTERS[order]
        or not 0.0 <= distance_m < math.inf
        or min(state, count) < 0
        or count > 1 << 40
    ):
        raise InputError(f"cursor={text[:80]!r}: made by a search in another order than {order}")
    return Cursor(order, int(t1_ns), int(ordinal), int(state), float(distance_m), int(count))

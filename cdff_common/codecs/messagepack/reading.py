# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unpacking by schema: long lists of numbers are read directly into arrays."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs import messagepack
from cdff_common.codecs.messagepack import _kernels as kernels
from cdff_common.errors import CodecError
from cdff_common.types.schema import Alias, Array, Field, Integer, Node, OctetString, Real, Struct

#: Lists of at least this many elements are read into an array.
_LONG = 128


def guided(data: bytes, node: Node | Alias) -> Any:
    """Unpack a message by its schema: long lists of numbers become arrays, the rest is as from ``unpack``.

    Raises
    ------
    CodecError
        If the bytes are not MessagePack.
    """
    buffer = np.frombuffer(data, dtype=np.uint8)
    end = int(kernels.skip(buffer, 0))
    if end != len(data):
        problem = (
            "cut off"
            if end == kernels.TRUNCATED
            else "malformed"
            if end < 0
            else f"followed by {len(data) - end} more"
        )
        raise CodecError(f"not MessagePack: {problem}")
    return _object(data, buffer, 0, end, node)


def _object(data: bytes, buffer: NDArray[np.uint8], at: int, end: int, node: Node | Alias) -> Any:
    """Return the object from ``at`` to ``end``, which is known to be complete."""
    match node:
        case Alias():
            return _object(data, buffer, at, end, node.node)
        case Struct():
            return _map(data, buffer, at, end, node)
        case Array() | OctetString():
            array = _numbers(buffer, at, end, node)
            return messagepack.unpack(data[at:end]) if array is None else array
        case _:
            return messagepack.unpack(data[at:end])


def _map(data: bytes, buffer: NDArray[np.uint8], at: int, end: int, node: Struct) -> Any:
    """Return the dictionary of a structure between two offsets; known fields are read by their node."""
    head = _header(buffer, at, 0x80, 0xDE)
    if head is None:
        return messagepack.unpack(data[at:end])
    count, at = head
    nodes = {name: f.node for f in node.fields for name in _names(f)}
    entries: dict[str, Any] = {}
    for _ in range(count):
        value_end = int(kernels.skip(buffer, at))
        key = messagepack.unpack(data[at:value_end])
        if not isinstance(key, str):
            raise CodecError(f"{node.name}: key {key!r}, expected the name of a field")
        at, value_end = value_end, int(kernels.skip(buffer, value_end))
        if key in nodes:
            entries[key] = _object(data, buffer, at, value_end, nodes[key])
        else:
            entries[key] = messagepack.unpack(data[at:value_end])
        at = value_end
    return entries


def _names(field: Field) -> tuple[str, str, str]:
    """Return the accepted spellings of the name of a field."""
    return field.key, field.name, field.attribute


def _header(buffer: NDArray[np.uint8], at: int, fixed: int, sized: int) -> tuple[int, int] | None:
    """Return number and start of the elements of a map or array, or None for another object."""
    first = int(buffer[at])
    if first & 0xF0 == fixed:
        return first & 0x0F, at + 1
    if first in (sized, sized + 1):
        octets = 2 << (first - sized)
        return int.from_bytes(buffer[at + 1 : at + 1 + octets].tobytes(), "big"), at + 1 + octets
    return None


def _numbers(buffer: NDArray[np.uint8], at: int, end: int, node: Array | OctetString) -> NDArray[Any] | None:
    """Return the array of a long list of numbers; None for others, which ``from_dict_form`` handles."""
    head = _header(buffer, at, 0x90, 0xDC)
    if head is None or head[0] < _LONG:
        return None
    rows, at = head
    if isinstance(node, OctetString) or isinstance(node.element, Integer):
        integers = np.empty(rows, dtype=np.int64)
        if (isinstance(node, Array) and len(node.dims) > 1) or kernels.read_integers(
            buffer, at, integers
        ) != end:
            return None
        return _narrow(integers, np.dtype(np.uint8) if isinstance(node, OctetString) else node.dtype)
    if not isinstance(node.element, Real) or len(node.dims) > 2:
        return None
    columns = 0
    if len(node.dims) == 2:
        inner = _header(buffer, at, 0x90, 0xDC)
        if inner is None or not 0 < inner[0] < 65536:
            return None
        columns = inner[0]
    if rows * max(columns, 1) > end - at:
        return None
    values = np.empty((rows, columns) if columns else rows, dtype=np.float64)
    flat = values.reshape(-1)
    if kernels.read_reals(buffer, at, rows, columns, flat, flat.view(np.int64)) != end:
        return None
    return values


def _narrow(integers: NDArray[np.int64], dtype: np.dtype[Any]) -> NDArray[Any] | None:
    """Return integers in the dtype of their type, or None if one does not fit."""
    info = np.iinfo(dtype)
    if int(integers.min()) < int(info.min) or int(integers.max()) > int(info.max):
        return None
    return integers.astype(dtype)

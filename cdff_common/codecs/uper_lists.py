# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unaligned PER of values with a length: lists of numbers, lists of messages, byte strings; long ones in
fragments.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.bits import BitReader, BitWriter
from cdff_common.codecs.sizes import CONSTRAINED_BELOW, bits_of
from cdff_common.codecs.uper_rows import LONG, rows_of, widths
from cdff_common.codecs.wire_types import array_of_bytes
from cdff_common.errors import CodecError
from cdff_common.types.schema import Array, Boolean, Integer, ListOf, Node, OctetString, Real

Put = Callable[[BitWriter, Any], None]
Get = Callable[[BitReader], Any]
Compiled = Callable[[Node], tuple[Put, Get]]


def bits_for(count: int) -> int:
    """Return the number of bits for ``count`` distinct values."""
    return (count - 1).bit_length()


def octet_string(node: OctetString) -> tuple[Put, Get]:
    """Return the functions that write and read an OCTET STRING."""

    def put(writer: BitWriter, value: NDArray[Any]) -> None:
        octets = value.reshape(-1).view(np.uint8)
        for begin, count in _parts(writer, len(octets), 0, node.high):
            writer.put_bytes(octets[begin : begin + count])

    def get(reader: BitReader) -> NDArray[Any]:
        parts = [reader.get_byte_array(size) for size in _counts(reader, 0, node.high)]
        return array_of_bytes(parts[0] if len(parts) == 1 else np.concatenate(parts), node)

    return put, get


def array(node: Array, compiled: Compiled) -> tuple[Put, Get]:
    """Return the functions for lists of numbers: rows of fixed size at once, others row by row."""
    low, high = node.dims[0]
    if any(a != b for a, b in node.dims[1:]):
        return _ragged_matrix_codec(node, compiled)
    row = tuple(a for a, _ in node.dims[1:])
    per_row = int(np.prod(row, dtype=np.int64))
    put_flat, get_flat, element_bits = _flat(node, compiled)

    def put(writer: BitWriter, value: NDArray[Any]) -> None:
        flat = value.reshape(-1)
        for begin, count in _parts(writer, len(value), low, high):
            put_flat(writer, flat[begin * per_row : (begin + count) * per_row])

    def get(reader: BitReader) -> NDArray[Any]:
        parts = []
        for count in _counts(reader, low, high):
            reader.require(count * per_row * element_bits, f"list of {count}")
            parts.append(get_flat(reader, count * per_row))
        flat = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return flat.reshape(-1, *row) if row else flat

    return put, get


def _flat(node: Array, compiled: Compiled) -> tuple[Put, Callable[[BitReader, int], NDArray[Any]], int]:
    """Return the functions for a sequence of numbers, and the smallest number of bits of one."""
    element = node.element
    if isinstance(element, Real):
        return (lambda w, v: w.put_reals(v)), (lambda r, n: r.get_reals(n)), 8
    put_one, get_one = compiled(element)
    dtype = node.dtype
    bits = 1 if isinstance(element, Boolean) else bits_for(element.high - element.low + 1)
    if isinstance(element, Integer) and bits == 8 * dtype.itemsize and bits < 64:
        offset = np.array(-element.low).astype(f"u{dtype.itemsize}")
        big, small = np.dtype(f">u{dtype.itemsize}"), np.dtype(f"u{dtype.itemsize}")

        def put_many(writer: BitWriter, values: NDArray[Any]) -> None:
            # modulo 2^bits the offset is exact for signed and unsigned numbers
            writer.put_bytes((values.view(small) + offset).astype(big).view(np.uint8))

        def get_many(reader: BitReader, count: int) -> NDArray[Any]:
            octets = reader.get_byte_array(count * dtype.itemsize)
            values: NDArray[Any] = octets.view(big).astype(small) - offset
            return values.view(dtype)

        return put_many, get_many, bits

    def put_each(writer: BitWriter, values: NDArray[Any]) -> None:
        for value in values.tolist():
            put_one(writer, value)

    def get_each(reader: BitReader, count: int) -> NDArray[Any]:
        return np.array([get_one(reader) for _ in range(count)], dtype=dtype)

    return put_each, get_each, bits


def _ragged_matrix_codec(node: Array, compiled: Compiled) -> tuple[Put, Get]:
    """Return the functions for a matrix whose rows are encoded with a length; all rows must have the same
    length.
    """
    inner = Array(node.element, node.dims[1:], node.tags[1:])
    put_row, get_row = array(inner, compiled)
    low, high = node.dims[0]
    dtype = node.dtype

    def put(writer: BitWriter, value: NDArray[Any]) -> None:
        for begin, count in _parts(writer, len(value), low, high):
            for row in value[begin : begin + count]:
                put_row(writer, row)

    def get(reader: BitReader) -> NDArray[Any]:
        rows = []
        for count in _counts(reader, low, high):
            reader.require(count, f"list of {count} rows")
            rows += [get_row(reader) for _ in range(count)]
        if len({r.shape for r in rows}) > 1:
            raise CodecError(
                f"matrix with rows of {sorted({len(r) for r in rows})} elements: expected rows of "
                "equal length"
            )
        return np.stack(rows) if rows else np.zeros((0,) * len(node.dims), dtype)

    return put, get


def list_of(node: ListOf, compiled: Compiled) -> tuple[Put, Get]:
    """Return the functions that write and read a list of messages."""
    put_one, get_one = compiled(node.element)
    low, high, least = node.low, node.high, max(1, bits_of(node.element)[0])
    fields = widths(node.element)
    put_rows, get_rows = (None, None) if fields is None else rows_of(node.element, fields)

    def put(writer: BitWriter, value: tuple[Any, ...]) -> None:
        for begin, count in _parts(writer, len(value), low, high):
            if put_rows is not None and count >= LONG:
                put_rows(writer, value[begin : begin + count])
                continue
            for item in value[begin : begin + count]:
                put_one(writer, item)

    def get(reader: BitReader) -> tuple[Any, ...]:
        items: list[Any] = []
        for count in _counts(reader, low, high):
            reader.require(count * least, f"list of {count}")
            if get_rows is not None and count >= LONG:
                items += get_rows(reader, count)
            else:
                items += [get_one(reader) for _ in range(count)]
        return tuple(items)

    return put, get


def _parts(writer: BitWriter, size: int, low: int, high: int) -> Iterable[tuple[int, int]]:
    """Write the lengths of a list while it is iterated; yield start and size of each part."""
    if high < CONSTRAINED_BELOW:
        if low != high:
            writer.put(size - low, bits_for(high - low + 1))
        return ((0, size),)
    return _fragments(writer, size)


def _fragments(writer: BitWriter, size: int) -> Iterator[tuple[int, int]]:
    """Write the lengths of the fragments of a list; yield first row and number of rows of each."""
    at = 0
    while True:
        part = writer.put_length(size - at)
        yield at, part
        at += part
        if part < 0x4000:
            return


def _counts(reader: BitReader, low: int, high: int) -> Iterator[int]:
    """Read the lengths of the parts of a list while it is iterated."""
    if high < CONSTRAINED_BELOW:
        count = low if low == high else reader.get(bits_for(high - low + 1)) + low
        if count > high:
            raise CodecError(f"list of {count}: expected {low}..{high}")
        yield count
        return
    total, more = 0, True
    while more:
        count, more = reader.get_length()
        total += count
        if total > high:
            raise CodecError(f"list of {total} or more: expected {low}..{high}")
        yield count

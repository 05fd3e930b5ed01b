# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unaligned PER (X.691) of the types' table: one pair of functions compiled for each node.

Agrees with asn1tools value for value. REALs are written with the shortest mantissa (asn1tools prepends a zero octet
to some, asn1scc appends zeros), -0 as such, NaN as NOT-A-NUMBER: its sign and payload are lost. Read are padded
messages, even mantissas and every other form of REAL that X.690 allows.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.codecs.bits import BitReader, BitWriter
from cdff_common.codecs.bridge import array_dtype, class_of, message_node, octets_as_array
from cdff_common.codecs.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    Octets,
    Real,
    Struct,
    Text,
)
from cdff_common.errors import CodecError, InputError

Put = Callable[[BitWriter, Any], None]
Get = Callable[[BitReader], Any]

#: Sizes above this have a length determinant instead of a number of bits, and may come in fragments (X.691 11.9.4.1).
_CONSTRAINED_BELOW = 65536


def encode(value: Any) -> bytes:
    """Encode a message."""
    put, _ = _codec(message_node(type(value).ASN1_NAME).name)
    writer = BitWriter()
    put(writer, value)
    return writer.to_bytes()


def decode(type_name: str, data: bytes) -> Any:
    """Decode a message; raises CodecError where the octets are none of that type."""
    name = message_node(type_name).name
    _, get = _codec(name)
    reader = BitReader(bytes(data))
    try:
        value = get(reader)
        reader.finish()
    except CodecError as error:
        raise CodecError(f"{name} as uper, {len(data)} octets: {error}") from error
    except InputError as error:
        raise CodecError(f"{name} as uper, {len(data)} octets: {error}") from error
    return value


@cache
def _codec(name: str) -> tuple[Put, Get]:
    return _compiled(message_node(name))


@cache
def _compiled(node: Node | Alias) -> tuple[Put, Get]:
    """Functions that write and read a node."""
    match node:
        case Integer():
            return _integer(node)
        case Boolean():
            return (lambda w, v: w.put(1 if v else 0, 1)), (lambda r: r.get(1) == 1)
        case Real():
            return (lambda w, v: w.put_reals(np.array([v]))), (lambda r: float(r.get_reals(1)[0]))
        case Enumeration():
            return _enumeration(node)
        case Text():
            return _text(node)
        case Octets():
            return _octets(node)
        case Array():
            return _array(node)
        case ListOf():
            return _list(node)
        case Struct():
            return _struct(node)
        case Choice():
            return _choice(node)
        case Alias():
            put, get = _compiled(node.node)
            attribute, name = node.attribute, node.class_name
            return (lambda w, v: put(w, getattr(v, attribute))), (lambda r: class_of(name)(get(r)))


def _bits(count: int) -> int:
    """Bits that tell ``count`` values apart."""
    return (count - 1).bit_length()


def _integer(node: Integer) -> tuple[Put, Get]:
    low, high, bits = node.low, node.high, _bits(node.high - node.low + 1)

    def get(reader: BitReader) -> int:
        value = reader.get(bits) + low
        if value > high:
            raise CodecError(f"INTEGER {value}: expected {low}..{high}")
        return value

    return (lambda w, v: w.put(v - low, bits)), get


def _enumeration(node: Enumeration) -> tuple[Put, Get]:
    values = [v for _, v in node.members]
    index = {v: i for i, v in enumerate(values)}
    bits = _bits(len(values))

    def get(reader: BitReader) -> Any:
        i = reader.get(bits)
        if i >= len(values):
            raise CodecError(f"{node.class_name} number {i}: expected below {len(values)}")
        return class_of(node.class_name)(values[i])

    return (lambda w, v: w.put(index[v], bits)), get


def _text(node: Text) -> tuple[Put, Get]:
    bits, high = _bits(node.high + 1), node.high

    def put(writer: BitWriter, value: str) -> None:
        octets = value.encode("utf-8", "surrogateescape")
        writer.put(len(octets), bits)
        writer.put_octets(octets)

    def get(reader: BitReader) -> str:
        size = reader.get(bits)
        if size > high:
            raise CodecError(f"T-String of {size} octets: expected at most {high}")
        return reader.get_octets(size).decode("utf-8", "surrogateescape")

    return put, get


def _octets(node: Octets) -> tuple[Put, Get]:
    if node.high < _CONSTRAINED_BELOW:
        raise ValueError(f"OCTET STRING of at most {node.high}: the table has none so short")

    def put(writer: BitWriter, value: NDArray[Any]) -> None:
        octets = value.reshape(-1).view(np.uint8)
        at, size = 0, len(octets)
        while True:
            part = writer.put_length(size - at)
            writer.put_octets(octets[at : at + part])
            at += part
            if part < 0x4000:
                return

    def get(reader: BitReader) -> NDArray[Any]:
        parts = []
        more = True
        while more:
            size, more = reader.get_length()
            parts.append(reader.get_octet_array(size))
        octets = parts[0] if len(parts) == 1 else np.concatenate(parts)
        if len(octets) > node.high:
            raise CodecError(f"OCTET STRING of {len(octets)}: expected at most {node.high}")
        return octets_as_array(octets, node)

    return put, get


def _array(node: Array) -> tuple[Put, Get]:
    """Lists of numbers: rows of fixed size in one go, others row by row."""
    low, high = node.dims[0]
    if any(a != b for a, b in node.dims[1:]):
        return _ragged(node)
    row = tuple(a for a, _ in node.dims[1:])
    per_row = int(np.prod(row, dtype=np.int64))
    put_flat, get_flat, element_bits = _flat(node)

    def put(writer: BitWriter, value: NDArray[Any]) -> None:
        flat = value.reshape(-1)
        for begin, count in _parts(writer, len(value), low, high):
            put_flat(writer, flat[begin * per_row : (begin + count) * per_row])

    def get(reader: BitReader) -> NDArray[Any]:
        parts = []
        for count in _counts(reader, low, high):
            reader.need(count * per_row * element_bits, f"list of {count}")
            parts.append(get_flat(reader, count * per_row))
        flat = parts[0] if len(parts) == 1 else np.concatenate(parts)
        return flat.reshape(-1, *row) if row else flat

    return put, get


def _flat(node: Array) -> tuple[Put, Callable[[BitReader, int], NDArray[Any]], int]:
    """Functions for a run of numbers, and the bits that one takes at least."""
    element = node.element
    if isinstance(element, Real):
        return (lambda w, v: w.put_reals(v)), (lambda r, n: r.get_reals(n)), 8
    put_one, get_one = _compiled(element)
    dtype = array_dtype(node)
    bits = 1 if isinstance(element, Boolean) else _bits(element.high - element.low + 1)
    if isinstance(element, Integer) and bits == 8 * dtype.itemsize and bits < 64:
        offset = np.array(-element.low).astype(f"u{dtype.itemsize}")
        big, small = np.dtype(f">u{dtype.itemsize}"), np.dtype(f"u{dtype.itemsize}")

        def put_many(writer: BitWriter, values: NDArray[Any]) -> None:
            # modulo 2^bits the offset is exact for signed and unsigned numbers
            writer.put_octets((values.view(small) + offset).astype(big).view(np.uint8))

        def get_many(reader: BitReader, count: int) -> NDArray[Any]:
            octets = reader.get_octet_array(count * dtype.itemsize)
            values: NDArray[Any] = octets.view(big).astype(small) - offset
            return values.view(dtype)

        return put_many, get_many, bits

    def put_each(writer: BitWriter, values: NDArray[Any]) -> None:
        for value in values.tolist():
            put_one(writer, value)

    def get_each(reader: BitReader, count: int) -> NDArray[Any]:
        return np.array([get_one(reader) for _ in range(count)], dtype=dtype)

    return put_each, get_each, bits


def _ragged(node: Array) -> tuple[Put, Get]:
    """A matrix whose rows have a length on the wire; all rows must be alike."""
    inner = Array(node.element, node.dims[1:], node.tags[1:])
    put_row, get_row = _array(inner)
    low, high = node.dims[0]
    dtype = array_dtype(node)

    def put(writer: BitWriter, value: NDArray[Any]) -> None:
        for begin, count in _parts(writer, len(value), low, high):
            for row in value[begin : begin + count]:
                put_row(writer, row)

    def get(reader: BitReader) -> NDArray[Any]:
        rows = []
        for count in _counts(reader, low, high):
            reader.need(count, f"list of {count} rows")
            rows += [get_row(reader) for _ in range(count)]
        if len({r.shape for r in rows}) > 1:
            raise CodecError(f"matrix with rows of {sorted({len(r) for r in rows})} elements: expected rows alike")
        return np.stack(rows) if rows else np.zeros((0,) * len(node.dims), dtype)

    return put, get


def _list(node: ListOf) -> tuple[Put, Get]:
    put_one, get_one = _compiled(node.element)
    low, high, least = node.low, node.high, _least_bits(node.element)

    def put(writer: BitWriter, value: tuple[Any, ...]) -> None:
        for begin, count in _parts(writer, len(value), low, high):
            for item in value[begin : begin + count]:
                put_one(writer, item)

    def get(reader: BitReader) -> tuple[Any, ...]:
        items: list[Any] = []
        for count in _counts(reader, low, high):
            reader.need(count * least, f"list of {count}")
            items += [get_one(reader) for _ in range(count)]
        return tuple(items)

    return put, get


def _parts(writer: BitWriter, size: int, low: int, high: int) -> list[tuple[int, int]] | Any:
    """Write the lengths of a list as its parts are taken; yields where each part begins and its size."""
    if high < _CONSTRAINED_BELOW:
        if low != high:
            writer.put(size - low, _bits(high - low + 1))
        return ((0, size),)
    return _fragments(writer, size)


def _fragments(writer: BitWriter, size: int) -> Any:
    at = 0
    while True:
        part = writer.put_length(size - at)
        yield at, part
        at += part
        if part < 0x4000:
            return


def _counts(reader: BitReader, low: int, high: int) -> Any:
    """Read the lengths of a list as its parts are taken."""
    if high < _CONSTRAINED_BELOW:
        count = low if low == high else reader.get(_bits(high - low + 1)) + low
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


def _least_bits(node: Node) -> int:
    """Bits that a node takes at least, 1 or more."""
    match node:
        case Struct():
            return max(1, sum(_least_bits(f.node) for f in node.fields))
        case Real():
            return 8
        case Array():
            each = 8 if isinstance(node.element, Real) else 1
            return max(1, each * int(np.prod([low for low, _ in node.dims], dtype=np.int64)))
        case Integer():
            return _bits(node.high - node.low + 1)
        case _:
            return 1


def _struct(node: Struct) -> tuple[Put, Get]:
    fields = [(f.attribute, f.name, *_compiled(f.node)) for f in node.fields]

    def put(writer: BitWriter, value: Any) -> None:
        for attribute, _, put_field, _ in fields:
            put_field(writer, getattr(value, attribute))

    def get(reader: BitReader) -> Any:
        values = []
        for _, name, _, get_field in fields:
            try:
                values.append(get_field(reader))
            except CodecError as error:
                raise CodecError(f"{name}: {error}") from error
        return class_of(node.class_name)(*values)

    return put, get


def _choice(node: Choice) -> tuple[Put, Get]:
    alternatives = [(f.attribute, *_compiled(f.node)) for f in node.alternatives]
    index = {f.attribute: i for i, f in enumerate(node.alternatives)}
    bits = _bits(len(alternatives))

    def put(writer: BitWriter, value: Any) -> None:
        i = index[value.kind]
        writer.put(i, bits)
        alternatives[i][1](writer, value.value)

    def get(reader: BitReader) -> Any:
        i = reader.get(bits)
        if i >= len(alternatives):
            raise CodecError(f"alternative {i} of {node.class_name}: expected below {len(alternatives)}")
        return class_of(node.class_name)(alternatives[i][0], alternatives[i][2](reader))

    return put, get

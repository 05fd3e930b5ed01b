# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Unaligned PER (X.691) of the schema table: one pair of functions per node.

Agrees with asn1tools value for value. REALs are written with the shortest mantissa (asn1tools prepends a zero
octet to some, asn1scc appends zeros), -0 as such, NaN as NOT-A-NUMBER without its sign and payload. The
decoder also accepts padded messages, even mantissas and every other form of REAL of X.690.
"""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cdff_common.codecs.bits import BitReader, BitWriter
from cdff_common.codecs.uper_lists import Get, Put, array, bits_for, list_of, octet_string
from cdff_common.codecs.wire_types import message_node, wire_node
from cdff_common.errors import CodecError, InputError
from cdff_common.types.schema import (
    Alias,
    Array,
    Boolean,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Node,
    OctetString,
    Real,
    Struct,
    Text,
)
from cdff_common.types.validation import class_of


def encode(value: Any, type_name: str | None = None) -> bytes:
    """Encode a message as the size variant that can hold it, or as ``type_name``."""
    put, _ = _codec(wire_node(value, type_name).name)
    writer = BitWriter()
    put(writer, value)
    return writer.to_bytes()


def decode(type_name: str, data: bytes) -> Any:
    """Decode a message; raises CodecError if the bytes are not a message of that type."""
    name = message_node(type_name).name
    _, get = _codec(name)
    reader = BitReader(bytes(data))
    try:
        value = get(reader)
        reader.finish()
    except InputError as error:
        raise CodecError(f"{name} as uper, {len(data)} bytes: {error}") from error
    return value


@cache
def _codec(name: str) -> tuple[Put, Get]:
    """Return the functions that write and read a message type."""
    return _compile_node(message_node(name))


@cache
def _compile_node(node: Node | Alias) -> tuple[Put, Get]:
    """Return the functions that write and read a node."""
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
        case OctetString():
            return octet_string(node)
        case Array():
            return array(node, _compile_node)
        case ListOf():
            return list_of(node, _compile_node)
        case Struct():
            return _struct(node)
        case Choice():
            return _choice(node)
        case Alias():
            put, get = _compile_node(node.node)
            attribute, name = node.attribute, node.class_name
            return (lambda w, v: put(w, getattr(v, attribute))), (lambda r: class_of(name)(get(r)))


def _integer(node: Integer) -> tuple[Put, Get]:
    """Return the functions that write and read an integer within bounds."""
    low, high, bits = node.low, node.high, bits_for(node.high - node.low + 1)

    def get(reader: BitReader) -> int:
        value = reader.get(bits) + low
        if value > high:
            raise CodecError(f"INTEGER {value}: expected {low}..{high}")
        return value

    return (lambda w, v: w.put(v - low, bits)), get


def _enumeration(node: Enumeration) -> tuple[Put, Get]:
    """Return the functions that write and read an enumeration as the number of its member."""
    values = [v for _, v in node.members]
    index = {v: i for i, v in enumerate(values)}
    bits = bits_for(len(values))

    def get(reader: BitReader) -> Any:
        i = reader.get(bits)
        if i >= len(values):
            raise CodecError(f"{node.class_name} number {i}: expected below {len(values)}")
        return class_of(node.class_name)(values[i])

    return (lambda w, v: w.put(index[v], bits)), get


def _text(node: Text) -> tuple[Put, Get]:
    """Return the functions that write and read a text as UTF-8 with its number of bytes."""
    bits, high = bits_for(node.high + 1), node.high

    def put(writer: BitWriter, value: str) -> None:
        octets = value.encode("utf-8", "surrogateescape")
        writer.put(len(octets), bits)
        writer.put_bytes(octets)

    def get(reader: BitReader) -> str:
        size = reader.get(bits)
        if size > high:
            raise CodecError(f"T-String of {size} bytes: expected at most {high}")
        return reader.get_bytes(size).decode("utf-8", "surrogateescape")

    return put, get


def _struct(node: Struct) -> tuple[Put, Get]:
    """Return the functions that write and read the fields of a structure in their order."""
    fields = [(f.attribute, f.name, *_compile_node(f.node)) for f in node.fields]

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
    """Return the functions that write and read the number of an alternative and its value."""
    alternatives = [(f.attribute, *_compile_node(f.node)) for f in node.alternatives]
    index = {f.attribute: i for i, f in enumerate(node.alternatives)}
    bits = bits_for(len(alternatives))

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

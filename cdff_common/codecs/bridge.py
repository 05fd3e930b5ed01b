# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Between messages and the nested Python values that asn1tools takes and gives."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np

from cdff_common import types as message_types
from cdff_common.codecs.schema import (
    Alias,
    Array,
    Choice,
    Enumeration,
    Integer,
    ListOf,
    Message,
    Node,
    Octets,
    Real,
    Struct,
    Text,
)
from cdff_common.codecs.schema_table import LARGE, MESSAGES
from cdff_common.errors import CodecError


@cache
def _by_name() -> dict[str, Message]:
    """ASN.1 names and class names of all messages; a class name is that of the smaller of two siblings."""
    larger = set(LARGE.values())
    return {**{m.class_name: m for name, m in MESSAGES.items() if name not in larger}, **MESSAGES}


def message_node(type_name: str) -> Message:
    """Node of a type by ASN.1 name, class name, or either with InFuse's ``asn1Scc`` before it and ``_`` for ``-``.

    Raises
    ------
    CodecError
        If there is no such type.
    """
    names = _by_name()
    plain = type_name.removeprefix("asn1Scc")
    for name in (plain, plain.replace("_", "-")):
        if name in names:
            return names[name]
    raise CodecError(f"type {type_name!r}: expected a type of the ASN.1 modules, as Pointcloud")


def class_of(class_name: str) -> Any:
    """Python class of a node."""
    return getattr(message_types, class_name)


def integer_dtype(node: Integer) -> np.dtype[Any]:
    """Smallest dtype that holds low..high."""
    for bits in (8, 16, 32, 64):
        if node.low >= 0 and node.high < 1 << bits:
            return np.dtype(f"uint{bits}")
        if -(1 << (bits - 1)) <= node.low and node.high < 1 << (bits - 1):
            return np.dtype(f"int{bits}")
    raise ValueError(f"INTEGER {node.low}..{node.high} does not fit 64 bits")


def array_dtype(node: Array) -> np.dtype[Any]:
    """Dtype of the array that a node becomes."""
    if isinstance(node.element, Integer):
        return integer_dtype(node.element)
    return np.dtype(np.float64 if isinstance(node.element, Real) else np.bool_)


def to_asn1(value: Any, node: Node | Alias) -> Any:
    """Value as asn1tools takes it."""
    match node:
        case Struct():
            return {f.name: to_asn1(getattr(value, f.attribute), f.node) for f in node.fields}
        case Alias():
            return to_asn1(getattr(value, node.attribute), node.node)
        case Array():
            return value.tolist()
        case ListOf():
            return [to_asn1(v, node.element) for v in value]
        case Octets():
            return value.tobytes()
        case Text():
            return value.encode("utf-8", "surrogateescape")
        case Enumeration():
            return node.members[[v for _, v in node.members].index(int(value))][0]
        case Choice():
            field = next(f for f in node.alternatives if f.attribute == value.kind)
            return (field.name, to_asn1(value.value, field.node))
        case _:
            return value


def from_asn1(value: Any, node: Node | Alias) -> Any:
    """Inverse of ``to_asn1``: builds, and so checks, the messages."""
    match node:
        case Struct():
            return class_of(node.class_name)(*[from_asn1(value[f.name], f.node) for f in node.fields])
        case Alias():
            return class_of(node.class_name)(from_asn1(value, node.node))
        case Array():
            return np.array(value, dtype=array_dtype(node))
        case ListOf():
            return tuple(from_asn1(v, node.element) for v in value)
        case Octets():
            return octets_as_array(value, node)
        case Text():
            return value.decode("utf-8", "surrogateescape")
        case Enumeration():
            return class_of(node.class_name)(dict(node.members)[value])
        case Choice():
            name, content = value
            field = next(f for f in node.alternatives if f.name == name)
            return class_of(node.class_name)(field.attribute, from_asn1(content, field.node))
        case _:
            return value


def octets_as_array(data: Any, node: Octets) -> np.ndarray[Any, Any]:
    """Octets as the array they hold, without a copy where they are aligned.

    Raises
    ------
    CodecError
        If they are not a whole number of rows.
    """
    row = np.dtype(node.dtype).itemsize * max(node.columns, 1)
    if len(data) % row:
        raise CodecError(f"OCTET STRING of {len(data)} octets: expected a multiple of {row} ({node.dtype})")
    array = np.frombuffer(data, dtype=np.uint8)
    if array.size and array.ctypes.data % 8:
        array = array.copy()
    typed = array.view(node.dtype)
    return typed.reshape(-1, node.columns) if node.columns else typed

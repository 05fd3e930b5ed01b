# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ASN.1 types of messages: nodes of the schema by name, size variants, and arrays in octets.

The type of a message is that of InFuse or its size variant with larger bounds: ``Pointcloud`` holds 400 000
points, ``PointcloudLarge`` millions; both have the Python class ``Pointcloud``. A message is encoded as the
first type that can hold it, and decoded from either.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from cdff_common.errors import CodecError
from cdff_common.types.schema import Alias, Array, ListOf, Message, Node, OctetString, Struct
from cdff_common.types.schema_table import LARGE, MESSAGES

Fits = Callable[[Any], bool]
_BASES = {large: base for base, large in LARGE.items()}


@cache
def _by_name() -> dict[str, Message]:
    """Return all messages by ASN.1 name and class name; a class name refers to the smaller size variant."""
    larger = set(LARGE.values())
    return {**{m.class_name: m for name, m in MESSAGES.items() if name not in larger}, **MESSAGES}


def message_node(type_name: str) -> Message:
    """Return the node of a type by ASN.1 or class name, also in InFuse's form (``asn1Scc`` prefix, ``_`` for
    ``-``).

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
    raise CodecError(f"type {type_name!r}: expected a type of the ASN.1 modules, e.g. Pointcloud")


def base_type(type_name: str) -> str:
    """Return the type name without size variant: ``Pointcloud`` for ``PointcloudLarge``."""
    return _BASES.get(type_name, type_name)


def wire_type(value: Any) -> str:
    """Return the ASN.1 type for encoding a message: the smaller size variant if the message fits it, else the
    larger.
    """
    name: str = type(value).ASN1_NAME
    if name in LARGE and not _fits(name)(value):
        return LARGE[name]
    return name


def wire_node(value: Any, type_name: str | None = None) -> Message:
    """Return the node for encoding a message; ``type_name`` selects one of the size variants.

    Raises
    ------
    CodecError
        If the message is not of that type, or too large for it.
    """
    if type_name is None:
        return message_node(wire_type(value))
    node = message_node(type_name)
    type_of_value: str = type(value).ASN1_NAME
    if base_type(node.name) != type_of_value:
        raise CodecError(f"a {type_of_value} cannot be written as {node.name}")
    if node.name in LARGE and not _fits(node.name)(value):
        raise CodecError(f"too large for {node.name}: expected {LARGE[node.name]}")
    return node


def array_of_bytes(data: Any, node: OctetString) -> np.ndarray[Any, Any]:
    """Return the array in the bytes of an OCTET STRING, without a copy if they are aligned.

    Raises
    ------
    CodecError
        If the size is not a multiple of the row size.
    """
    row = np.dtype(node.dtype).itemsize * max(node.columns, 1)
    if len(data) % row:
        raise CodecError(f"OCTET STRING of {len(data)} bytes: expected a multiple of {row} ({node.dtype})")
    array = np.frombuffer(data, dtype=np.uint8)
    if array.size and array.ctypes.data % 8:
        array = array.copy()
    typed = array.view(node.dtype)
    return typed.reshape(-1, node.columns) if node.columns else typed


@cache
def _fits(name: str) -> Fits:
    """Return the check whether a message fits the smaller size variant, by the differing bounds."""
    return _check(MESSAGES[name], MESSAGES[LARGE[name]]) or (lambda value: True)


def _check(small: Node | Alias, large: Node | Alias) -> Fits | None:
    """Return the check of the value of a node, or None if the bounds are equal."""
    match small, large:
        case (Struct(), Struct()):
            parts = [
                (f.attribute, check)
                for f, g in zip(small.fields, large.fields, strict=True)
                if (check := _check(f.node, g.node)) is not None
            ]
            return (
                (lambda value: all(check(getattr(value, name)) for name, check in parts)) if parts else None
            )
        case (Alias(), Alias()):
            inner, attribute = _check(small.node, large.node), small.attribute
            return None if inner is None else (lambda value: inner(getattr(value, attribute)))
        case (OctetString(), OctetString()):
            limit = small.high
            return None if limit == large.high else (lambda value: value.nbytes <= limit)
        case (Array(), Array()):
            limit = small.dims[0][1]
            return None if small.dims == large.dims else (lambda value: len(value) <= limit)
        case (ListOf(), ListOf()):
            limit, element_fits = small.high, _check(small.element, large.element)
            if element_fits is None:
                return None if limit == large.high else (lambda value: len(value) <= limit)
            return lambda value: len(value) <= limit and all(element_fits(item) for item in value)
        case _:
            return None

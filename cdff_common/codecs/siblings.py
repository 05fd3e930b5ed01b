# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which ASN.1 type a message travels as: InFuse's, or its sibling with room for more where that is too small.

``Pointcloud`` takes 400 000 points, ``PointcloudLarge`` millions; both are the one Python class ``Pointcloud``. A
message is written as the first that it fits, and reads the same whichever it came as.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

from cdff_common.codecs.schema import Alias, Array, ListOf, Message, Node, Octets, Struct
from cdff_common.codecs.schema_table import LARGE, MESSAGES
from cdff_common.errors import CodecError

Fits = Callable[[Any], bool]
_BASES = {large: base for base, large in LARGE.items()}


def base_type(type_name: str) -> str:
    """Name of the type that a name stands for at a port: ``PointcloudLarge`` and ``Pointcloud`` are ``Pointcloud``."""
    return _BASES.get(type_name, type_name)


def wire_type(value: Any) -> str:
    """ASN.1 name of the type that a message is written as: its own, or that of the sibling where it is too large."""
    name: str = type(value).ASN1_NAME
    if name in LARGE and not _fits(name)(value):
        return LARGE[name]
    return name


def wire_node(value: Any, type_name: str | None = None) -> Message:
    """Node that a message is written as; ``type_name`` asks for one of the siblings.

    Raises
    ------
    CodecError
        If the message is not of that type, or too large for it.
    """
    from cdff_common.codecs.bridge import message_node

    if type_name is None:
        return message_node(wire_type(value))
    node = message_node(type_name)
    own: str = type(value).ASN1_NAME
    if base_type(node.name) != own:
        raise CodecError(f"a {own} cannot be written as {node.name}")
    if node.name in LARGE and not _fits(node.name)(value):
        raise CodecError(f"too large for {node.name}: expected {LARGE[node.name]}")
    return node


@cache
def _fits(name: str) -> Fits:
    """Whether a message fits the smaller of two siblings; looks only at what can be larger in the other."""
    return _check(MESSAGES[name], MESSAGES[LARGE[name]]) or (lambda value: True)


def _check(small: Node | Alias, large: Node | Alias) -> Fits | None:
    """Check of the value of a node; None where the nodes are alike."""
    match small, large:
        case (Struct(), Struct()):
            parts = [
                (f.attribute, check)
                for f, g in zip(small.fields, large.fields, strict=True)
                if (check := _check(f.node, g.node)) is not None
            ]
            return (lambda value: all(check(getattr(value, name)) for name, check in parts)) if parts else None
        case (Alias(), Alias()):
            inner, attribute = _check(small.node, large.node), small.attribute
            return None if inner is None else (lambda value: inner(getattr(value, attribute)))
        case (Octets(), Octets()):
            most = small.high
            return None if most == large.high else (lambda value: value.nbytes <= most)
        case (Array(), Array()):
            most = small.dims[0][1]
            return None if small.dims == large.dims else (lambda value: len(value) <= most)
        case (ListOf(), ListOf()):
            most, each = small.high, _check(small.element, large.element)
            if each is None:
                return None if most == large.high else (lambda value: len(value) <= most)
            return lambda value: len(value) <= most and all(each(item) for item in value)
        case _:
            return None

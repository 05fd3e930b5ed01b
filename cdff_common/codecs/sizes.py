# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""How many bits a message of a type takes in UPER, at least and at most."""

from __future__ import annotations

from cdff_common.codecs.bridge import message_node
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

#: Octets of a float64 as we write it, with its length: head, exponent of two, mantissa of seven.
REAL_OCTETS = 11
_CONSTRAINED_BELOW = 65536
_BLOCK = 16384


def uper_octets(type_name: str, real_octets: int = REAL_OCTETS) -> tuple[int, int]:
    """Least and most octets of a message in UPER.

    Parameters
    ----------
    real_octets : int
        Most octets of a REAL with its length; asn1scc reckons with 13, and pads every message to the most.
    """
    least, most = _bits(message_node(type_name), real_octets)
    return max(1, (least + 7) // 8), max(1, (most + 7) // 8)


def _bits(node: Node | Alias, real: int) -> tuple[int, int]:
    match node:
        case Real():
            return 8, 8 * real
        case Integer():
            bits = (node.high - node.low).bit_length()
            return bits, bits
        case Boolean():
            return 1, 1
        case Enumeration():
            bits = (len(node.members) - 1).bit_length()
            return bits, bits
        case Text():
            return _list(0, node.high, (8, 8))
        case Octets():
            return _list(0, node.high, (8, 8))
        case Array():
            element = _bits(node.element, real)
            for low, high in reversed(node.dims):
                element = _list(low, high, element)
            return element
        case ListOf():
            return _list(node.low, node.high, _bits(node.element, real))
        case Struct():
            parts = [_bits(f.node, real) for f in node.fields]
            return sum(a for a, _ in parts), sum(b for _, b in parts)
        case Choice():
            parts = [_bits(f.node, real) for f in node.alternatives]
            index = (len(parts) - 1).bit_length()
            return index + min(a for a, _ in parts), index + max(b for _, b in parts)
        case Alias():
            return _bits(node.node, real)


def _list(low: int, high: int, element: tuple[int, int]) -> tuple[int, int]:
    """Bits of ``low`` to ``high`` elements with their length determinants (X.691 11.9)."""
    return _length(low, low, high) + low * element[0], _length(high, low, high) + high * element[1]


def _length(count: int, low: int, high: int) -> int:
    """Bits of the length determinants of ``count`` elements."""
    if high < _CONSTRAINED_BELOW:
        return (high - low).bit_length()
    blocks, rest = divmod(count, _BLOCK)
    return 8 * ((blocks + 3) // 4) + (8 if rest < 128 else 16)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Smallest and largest size of a message in UPER."""

from __future__ import annotations

from cdff_common.codecs.wire_types import message_node
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

#: Largest size of an encoded float64, bytes: 1 for length, 1 for header, 2 for exponent, 7 for mantissa.
REAL_OCTETS = 11
#: Sizes of at least this value have a length determinant and may be split into fragments (X.691 11.9.4.1).
CONSTRAINED_BELOW = 65536
#: Number of elements of a block; a fragment has one to four (X.691, 11.9.3.8).
_BLOCK = 16384


def uper_bytes(type_name: str, real_octets: int = REAL_OCTETS) -> tuple[int, int]:
    """Return the smallest and largest size of a message in UPER, bytes.

    Parameters
    ----------
    real_octets : int
        Largest size of a REAL with its length; asn1scc assumes 13 and pads every message to its largest size.
    """
    least, most = bits_of(message_node(type_name), real_octets)
    return max(1, (least + 7) // 8), max(1, (most + 7) // 8)


def bits_of(node: Node | Alias, real_octets: int = REAL_OCTETS) -> tuple[int, int]:
    """Return the smallest and largest number of bits of a node."""
    match node:
        case Real():
            return 8, 8 * real_octets
        case Integer():
            bits = (node.high - node.low).bit_length()
            return bits, bits
        case Boolean():
            return 1, 1
        case Enumeration():
            bits = (len(node.members) - 1).bit_length()
            return bits, bits
        case Text() | OctetString():
            return _list(0, node.high, (8, 8))
        case Array():
            element = bits_of(node.element, real_octets)
            for low, high in reversed(node.dims):
                element = _list(low, high, element)
            return element
        case ListOf():
            return _list(node.low, node.high, bits_of(node.element, real_octets))
        case Struct():
            parts = [bits_of(f.node, real_octets) for f in node.fields]
            return sum(a for a, _ in parts), sum(b for _, b in parts)
        case Choice():
            parts = [bits_of(f.node, real_octets) for f in node.alternatives]
            index = (len(parts) - 1).bit_length()
            return index + min(a for a, _ in parts), index + max(b for _, b in parts)
        case Alias():
            return bits_of(node.node, real_octets)


def _list(low: int, high: int, element: tuple[int, int]) -> tuple[int, int]:
    """Return the bits of ``low`` to ``high`` elements with their length determinants (X.691 11.9)."""
    return _length(low, low, high) + low * element[0], _length(high, low, high) + high * element[1]


def _length(count: int, low: int, high: int) -> int:
    """Return the bits of the length determinants of ``count`` elements."""
    if high < CONSTRAINED_BELOW:
        return (high - low).bit_length()
    blocks, rest = divmod(count, _BLOCK)
    return 8 * ((blocks + 3) // 4) + (8 if rest < 128 else 16)

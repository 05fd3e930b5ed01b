# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ASN.1 types that ports use, with all types to which they refer, their files and sizes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from cdff_common.asn1 import ASN1_DIR
from cdff_common.codecs.sizes import bits_of
from cdff_common.errors import InputError
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
from cdff_dev.generate.asn1_model import model_reader

#: Largest size of a REAL with its length that asn1scc assumes, bytes.
_REAL_OCTETS = 13
#: Sizes in data views are multiples of this.
_ALIGNMENT = 8


@dataclass(frozen=True, slots=True)
class UsedType:
    """ASN.1 type of a data view.

    Attributes
    ----------
    name, module : str
        As in the ASN.1 file.
    path : Path
        The file.
    kind : str
        ASN.1 kind, e.g. ``SEQUENCE``; of another name for a type the kind of that type.
    node : node of the schema
    """

    name: str
    module: str
    path: Path
    kind: str
    node: Node | Alias

    @property
    def aadl_name(self) -> str:
        """Name in AADL and in C."""
        return self.name.replace("-", "_")

    @property
    def message_bytes(self) -> int:
        """Largest size of all forms of a message: in UPER, or as a structure of C."""
        _, most = bits_of(self.node, _REAL_OCTETS)
        return max((most + 7) // 8, structure_size(self.node)[0], 1)

    @property
    def buffer_bytes(self) -> int:
        """Size of a buffer for the message, as ``asn2aadl`` rounds it."""
        return -(-self.message_bytes // _ALIGNMENT) * _ALIGNMENT


def used_types(names: Iterable[str]) -> list[UsedType]:
    """Return types with all types to which they refer, each after those to which it refers.

    Raises
    ------
    InputError
        If a name is not that of an ASN.1 type.
    """
    reader = model_reader()
    declarations = reader.declarations
    found: dict[str, UsedType] = {}

    def add(name: str) -> None:
        if name in found:
            return
        declaration, stem, module = declarations[name]
        for other in _references(declaration):
            if other in declarations:
                add(other)
        kind = declaration["type"]
        root = found[kind].kind if kind in found else kind
        found[name] = UsedType(name, module, ASN1_DIR / f"{stem}.asn", root, reader.node(name))

    for name in names:
        if name not in declarations:
            raise InputError(f"type {name!r}: expected an ASN.1 type of docs/reference/types.md")
        add(name)
    return list(found.values())


def _references(declaration: dict[str, Any]) -> list[str]:
    """Return the names in a declaration, in order."""
    names = [declaration["type"]]
    for member in declaration.get("members", ()):
        names += _references(member)
    if "element" in declaration:
        names += _references(declaration["element"])
    return names


def structure_size(node: Node | Alias) -> tuple[int, int]:
    """Return the size and the alignment of a type as a structure of asn1scc in C, bytes, with 64 bit words.

    INTEGER has 8 bytes, an enumeration and the number of elements of a list with a variable size 4.
    """
    match node:
        case Real() | Integer():
            return 8, 8
        case Boolean():
            return 1, 1
        case Enumeration():
            return 4, 4
        case Text() | OctetString():
            return _list_size(0, node.high, (1, 1))
        case Array():
            size = structure_size(node.element)
            for low, high in reversed(node.dims):
                size = _list_size(low, high, size)
            return size
        case ListOf():
            return _list_size(node.low, node.high, structure_size(node.element))
        case Struct():
            return _padded([structure_size(f.node) for f in node.fields])
        case Choice():
            parts = [structure_size(f.node) for f in node.alternatives]
            alignment = max(a for _, a in parts)
            return _padded([(4, 4), (max(s for s, _ in parts), alignment)])
        case Alias():
            return structure_size(node.node)


def _list_size(low: int, high: int, element: tuple[int, int]) -> tuple[int, int]:
    array = (element[0] * high, element[1])
    return array if low == high else _padded([(4, 4), array])


def _padded(parts: list[tuple[int, int]]) -> tuple[int, int]:
    """Return the size of members in order, each at a multiple of its alignment."""
    end, alignment = 0, 1
    for size, needed in parts:
        end = -(-end // needed) * needed + size
        alignment = max(alignment, needed)
    return -(-end // alignment) * alignment, alignment

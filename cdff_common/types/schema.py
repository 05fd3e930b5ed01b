# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Schema of a type: a tree of nodes, generated from the ASN.1 modules into ``schema_table``.

A named type that is not a SEQUENCE (``Matrix3d``, ``PosesSequence``) is represented by its content where it
is a field (an array or a tuple), and by an ``Alias`` with a class of one attribute where it is a message.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

Bounds = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Real:
    """REAL: ``float``; NaN, infinities and -0 are encoded according to X.690 8.5.9."""


@dataclass(frozen=True, slots=True)
class Integer:
    """INTEGER (low..high): ``int``."""

    low: int
    high: int

    @property
    def scalar_name(self) -> str:
        """Name of the smallest numpy scalar type that holds low..high."""
        for bits in (8, 16, 32, 64):
            if self.low >= 0 and self.high < 1 << bits:
                return f"uint{bits}"
            if -(1 << (bits - 1)) <= self.low and self.high < 1 << (bits - 1):
                return f"int{bits}"
        raise ValueError(f"INTEGER {self.low}..{self.high} does not fit 64 bits")


@dataclass(frozen=True, slots=True)
class Boolean:
    """BOOLEAN: ``bool``."""


@dataclass(frozen=True, slots=True)
class Enumeration:
    """ENUMERATED: an ``IntEnum`` of that class; ``members`` are (ASN.1 name, value) in order of value."""

    class_name: str
    members: tuple[tuple[str, int], ...]


@dataclass(frozen=True, slots=True)
class Text:
    """T-String: OCTET STRING of at most ``high`` octets with UTF-8 text: ``str``."""

    high: int


@dataclass(frozen=True, slots=True)
class OctetString:
    """OCTET STRING (SIZE(0..high)): array of ``dtype``, shape (n,), or (n, columns) if ``columns`` > 0."""

    high: int
    dtype: str = "|u1"
    columns: int = 0

    @property
    def scalar_name(self) -> str:
        """Name of the numpy scalar type of the array."""
        return np.dtype(self.dtype).name


@dataclass(frozen=True, slots=True)
class Array:
    """SEQUENCE OF (SEQUENCE OF …) numbers: one array.

    ``dims`` holds the size bounds and ``tags`` the names of the elements' types in XML, outermost first.
    """

    element: Real | Integer | Boolean
    dims: tuple[Bounds, ...]
    tags: tuple[str, ...]

    @property
    def scalar_name(self) -> str:
        """Name of the numpy scalar type of the array."""
        if isinstance(self.element, Integer):
            return self.element.scalar_name
        return "float64" if isinstance(self.element, Real) else "bool_"

    @property
    def dtype(self) -> np.dtype[Any]:
        """Dtype of the array."""
        return np.dtype(self.scalar_name.removesuffix("_"))


@dataclass(frozen=True, slots=True)
class ListOf:
    """SEQUENCE OF anything else: ``tuple``; ``tag`` is the name of the element's type in XML."""

    element: Node
    low: int
    high: int
    tag: str


@dataclass(frozen=True, slots=True)
class Field:
    """Component of a SEQUENCE: ASN.1 name, Python attribute, node."""

    name: str
    attribute: str
    node: Node

    @property
    def key(self) -> str:
        """Name in the dict form of logs and in C: ``-`` replaced by ``_``."""
        return self.name.replace("-", "_")


@dataclass(frozen=True, slots=True)
class Struct:
    """SEQUENCE: an object of that class."""

    name: str
    class_name: str
    fields: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """CHOICE: an object with ``kind`` (attribute name of the alternative) and ``value``."""

    class_name: str
    alternatives: tuple[Field, ...]


@dataclass(frozen=True, slots=True)
class Alias:
    """Named type that is not a SEQUENCE, as a message of its own: ``attribute`` holds its content."""

    name: str
    class_name: str
    attribute: str
    node: Array | ListOf


Node = Real | Integer | Boolean | Enumeration | Text | OctetString | Array | ListOf | Struct | Choice
Message = Struct | Alias


def fields_of(node: Message | Enumeration | Choice) -> tuple[Field, ...]:
    """Return the fields of a SEQUENCE, the alternatives of a CHOICE, or the content of another named type."""
    match node:
        case Struct():
            return node.fields
        case Choice():
            return node.alternatives
        case Alias():
            return (Field(node.attribute, node.attribute, node.node),)
        case Enumeration():
            return ()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the codecs know of a type: a tree of nodes, generated from the ASN.1 modules into ``schema_table``.

A named type that is no SEQUENCE (``Matrix3d``, ``PosesSequence``) is its content where it is a field, an array or
a tuple, and an ``Alias`` with a class of one attribute where it is a message of its own.
"""

from __future__ import annotations

from dataclasses import dataclass

Bounds = tuple[int, int]


@dataclass(frozen=True, slots=True)
class Real:
    """REAL: ``float``; NaN, infinities and -0 travel as X.690 8.5.9 says."""


@dataclass(frozen=True, slots=True)
class Integer:
    """INTEGER (low..high): ``int``."""

    low: int
    high: int


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
    """T-String: OCTET STRING of at most ``high`` octets holding UTF-8: ``str``."""

    high: int


@dataclass(frozen=True, slots=True)
class Octets:
    """OCTET STRING (SIZE(0..high)): array of ``dtype``; ``columns`` 0 for a plain list, else elements in a row."""

    high: int
    dtype: str = "|u1"
    columns: int = 0


@dataclass(frozen=True, slots=True)
class Array:
    """SEQUENCE OF (SEQUENCE OF …) numbers: one array.

    ``dims`` holds the size bounds and ``tags`` the names of the elements' types in XML, outermost first.
    """

    element: Real | Integer | Boolean
    dims: tuple[Bounds, ...]
    tags: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class ListOf:
    """SEQUENCE OF anything else: ``tuple``; ``tag`` is the name of the element's type in XML."""

    element: Node
    low: int
    high: int
    tag: str


@dataclass(frozen=True, slots=True)
class Field:
    """A component: ASN.1 name, Python attribute, node."""

    name: str
    attribute: str
    node: Node

    @property
    def key(self) -> str:
        """Name in the plain form of logs and of C: ``-`` replaced by ``_``."""
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
    """A named type that is no SEQUENCE, as a message of its own: ``attribute`` holds its content."""

    name: str
    class_name: str
    attribute: str
    node: Array | ListOf


Node = Real | Integer | Boolean | Enumeration | Text | Octets | Array | ListOf | Struct | Choice
Message = Struct | Alias

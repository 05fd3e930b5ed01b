# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registry of types: their definitions by Typelib in XML (``.tlb``)."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any
from xml.etree import ElementTree

import numpy as np

from cdff_common.errors import CodecError
from cdff_dev.logs.formats.pocolog.decoding import (
    Compound,
    Enumeration,
    Fixed,
    FixedArray,
    Text,
    Type,
    Vector,
)

_KINDS = {"sint": "i", "uint": "u", "float": "f"}
_SIZES = {"i": (1, 2, 4, 8), "u": (1, 2, 4, 8), "f": (4, 8)}
_ARRAY = re.compile(r"(.+)\[(\d{1,10})\]")
#: Largest depth of types in types; ROCK's own have less than 10.
_MAX_DEPTH = 32
#: Largest object, bytes.
_MAX_SIZE = 1 << 30
#: Largest padding at the end of an object.
_MAX_PADDING = 4096


class Registry:
    """Types by name, for samples of the byte order ``<`` or ``>``; raises CodecError if it is not XML."""

    def __init__(self, xml: bytes, order: str) -> None:
        if b"<!" in xml.replace(b"<![CDATA[", b"").replace(b"<!--", b""):
            raise CodecError("type definitions with a document type or entities, expected none")
        try:
            root = ElementTree.fromstring(xml) if xml.strip(b" \n\0") else ElementTree.Element("typelib")
        except (ElementTree.ParseError, ValueError, LookupError) as error:
            raise CodecError(f"type definitions: {error}; expected XML of Typelib") from error
        self._order = order
        self._nodes = {node.get("name", ""): node for node in root}
        self._types: dict[str, Type] = {}
        self._depth = 0

    def build(self, name: str) -> Type:
        """Return a type.

        Raises
        ------
        CodecError
            If its definition is missing, invalid, recursive, or has pointers, opaque types or other content
            whose encoding is not defined.
        """
        if name not in self._types:
            self._depth += 1
            if self._depth > _MAX_DEPTH:
                raise CodecError(f"type {name}: recursive, or nested deeper than {_MAX_DEPTH} types")
            try:
                self._types[name] = self._built(name)
            except (ValueError, TypeError, OverflowError) as error:
                raise CodecError(f"type {name}: {error}") from error
            finally:
                self._depth -= 1
        return self._types[name]

    def _built(self, name: str) -> Type:
        """Return a type, built from its definition or its name; raises CodecError."""
        node = self._nodes.get(name)
        if node is None:
            if name.endswith("*"):
                raise CodecError(f"type {name}: a pointer, expected values only")
            if (array := _ARRAY.fullmatch(name)) is None:
                raise CodecError(f"type {name}: expected a definition")
            return self._array(name, self.build(array[1]), int(array[2]))
        builders: dict[str, Callable[[str, ElementTree.Element], Type]] = {
            "alias": lambda _, alias: self.build(alias.get("source", "")),
            "numeric": self._number,
            "character": self._number,
            "enum": self._enumeration,
            "container": self._container,
            "compound": self._compound,
        }
        if node.tag not in builders:
            raise CodecError(f"type {name}: {node.tag}, expected one of {', '.join(builders)}")
        return builders[node.tag](name, node)

    def _number(self, name: str, node: ElementTree.Element) -> Type:
        kind = "i" if node.tag == "character" else _KINDS.get(node.get("category", ""), "")
        size = _integer(node, "size")
        if size not in _SIZES.get(kind, ()):
            raise CodecError(f"type {name}: {node.get('category')} of {size} bytes, expected {_SIZES}")
        return Fixed(name, np.dtype(f"{self._order}{kind}{size}"))

    def _enumeration(self, name: str, node: ElementTree.Element) -> Type:
        symbols = {int(v.get("value", "")): v.get("symbol", "") for v in node.iter("value")}
        return Enumeration(name, np.dtype(f"{self._order}i4"), 0, symbols)

    def _array(self, name: str, element: Type, count: int) -> Type:
        if not 0 < count * max(element.size, element.min_bytes) <= _MAX_SIZE:
            raise CodecError(f"type {name}: {count} elements, expected 1 to {_MAX_SIZE} bytes of them")
        if isinstance(element, Fixed):
            return Fixed(name, np.dtype((element.dtype, (count,))))
        return FixedArray(name, count * element.size, element, count, count * element.min_bytes)

    def _container(self, name: str, node: ElementTree.Element) -> Type:
        """Return the type of a vector or string; raises CodecError for other containers."""
        element, kind = self.build(node.get("of", "")), node.get("kind")
        size = _integer(node, "size") if node.get("size") else 0
        if kind == "/std/string" and element.size == 1:
            return Text(name, size)
        if kind != "/std/vector":
            raise CodecError(
                f"type {name}: container {kind} of {element.name}, expected /std/vector or /std/string"
            )
        return Vector(name, size, element)

    def _compound(self, name: str, node: ElementTree.Element) -> Type:
        """Return the type of a structure; raises CodecError if its fields overlap."""
        fields = [
            (_integer(field, "offset"), field.get("name", ""), self.build(field.get("type", "")))
            for field in node.iter("field")
        ]
        fields.sort(key=lambda field: field[0])
        size = _integer(node, "size")
        members, end = [], 0
        for offset, field_name, kind in fields:
            gap = offset - end if end >= 0 else 0
            if gap < 0 or offset + kind.size > size:
                raise CodecError(
                    f"type {name}: field {field_name} at byte {offset}, expected {end} to {size}"
                )
            members.append((gap, field_name, kind))
            end = offset + kind.size if kind.size else -1  # a container of unstated size has no padding
        tail = size - end if end >= 0 else 0
        padding = tail + (fields[-1][2].padding if fields else 0)
        if padding > _MAX_PADDING:
            raise CodecError(
                f"type {name}: {padding} bytes after its fields, expected at most {_MAX_PADDING}"
            )
        if all(isinstance(kind, Fixed) for _, _, kind in fields):
            return Fixed(name, self._structure(fields, size), padding)
        min_bytes = tail + sum(gap + kind.min_bytes for gap, _, kind in members)
        return Compound(name, size, tuple(members), tail, min_bytes, padding)

    @staticmethod
    def _structure(fields: list[tuple[int, str, Any]], size: int) -> np.dtype[Any]:
        """Return the numpy type of a structure with fields (offset, name, type)."""
        return np.dtype(
            {
                "names": [name for _, name, _ in fields],
                "formats": [kind.dtype for _, _, kind in fields],
                "offsets": [offset for offset, _, _ in fields],
                "itemsize": size,
            }
        )


def _integer(node: ElementTree.Element, attribute: str) -> int:
    text = node.get(attribute, "")
    if not text.isdecimal() or len(text) > 10 or int(text) > _MAX_SIZE:
        raise CodecError(f"{attribute}={text!r} of {node.get('name')}: expected a number up to {_MAX_SIZE}")
    if attribute == "size" and int(text) == 0:
        raise CodecError(f"size of {node.get('name')} is 0: expected a positive number")
    return int(text)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Basic XER (X.693): one XML element per message, named after its type.

REAL is written as the shortest decimal that reads back as the same float64, ``<NOT-A-NUMBER/>``,
``<PLUS-INFINITY/>`` or ``<MINUS-INFINITY/>``, and -0 as ``-0``; bytes as hexadecimal digits. The decoder also
accepts ``NaN``, ``INF`` and ``-INF``, and any name for the elements of a list. Documents with a DTD are
refused, since entities can expand without bound.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Any
from xml.etree import ElementTree

import numpy as np

from cdff_common.codecs.wire_types import array_of_bytes, message_node, wire_node
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

_SPECIAL = {"NOT-A-NUMBER": math.nan, "PLUS-INFINITY": math.inf, "MINUS-INFINITY": -math.inf}
_SPECIAL_TEXT = {"NaN": math.nan, "INF": math.inf, "-INF": -math.inf}
_REAL = re.compile(r"-?\d{1,400}(\.\d{0,400})?([eE][+-]?\d{1,6})?\Z")
_INTEGER = re.compile(r"-?\d{1,20}\Z")
#: Largest depth of elements; all types are less deep.
_MAX_DEPTH = 32


def encode(value: Any, type_name: str | None = None) -> bytes:
    """Return a message as XML in UTF-8, without white space between the elements."""
    node = wire_node(value, type_name)
    return "".join(_element(node.name, value, node)).encode()


def _element(tag: str, value: Any, node: Node | Alias) -> Iterator[str]:
    yield f"<{tag}>"
    yield from _content(value, node)
    yield f"</{tag}>"


def _content(value: Any, node: Node | Alias) -> Iterator[str]:
    """Yield the XML content of a value without its own element."""
    match node:
        case Struct():
            for field in node.fields:
                yield from _element(field.name, getattr(value, field.attribute), field.node)
        case Alias():
            yield from _content(getattr(value, node.attribute), node.node)
        case Array():
            yield from _rows(value.tolist(), node.element, node.tags)
        case ListOf():
            for item in value:
                yield from _element(node.tag, item, node.element)
        case OctetString():
            yield value.tobytes().hex().upper()
        case Text():
            yield value.encode("utf-8", "surrogateescape").hex().upper()
        case Enumeration():
            yield f"<{node.members[[v for _, v in node.members].index(int(value))][0]}/>"
        case Choice():
            field = next(f for f in node.alternatives if f.attribute == value.kind)
            yield from _element(field.name, value.value, field.node)
        case Real():
            yield _real_text(value)
        case Boolean():
            yield "<true/>" if value else "<false/>"
        case Integer():
            yield str(value)


def _rows(values: list[Any], element: Real | Integer | Boolean, tags: tuple[str, ...]) -> Iterator[str]:
    """Yield the XML elements of nested rows of numbers or booleans."""
    for value in values:
        if len(tags) > 1:
            yield f"<{tags[0]}>"
            yield from _rows(value, element, tags[1:])
            yield f"</{tags[0]}>"
        elif isinstance(element, Boolean):
            yield "<true/>" if value else "<false/>"
        else:
            text = _real_text(value) if isinstance(element, Real) else str(value)
            yield f"<{tags[0]}>{text}</{tags[0]}>"


def _real_text(value: float) -> str:
    """Return the XMLRealValue of X.680 21.6: the exponent has no sign + and no leading zero."""
    if math.isnan(value):
        return "<NOT-A-NUMBER/>"
    if math.isinf(value):
        return "<PLUS-INFINITY/>" if value > 0 else "<MINUS-INFINITY/>"
    if value == 0.0:
        return "-0" if math.copysign(1.0, value) < 0 else "0"
    mantissa, _, exponent = repr(float(value)).partition("e")
    return f"{mantissa}E{int(exponent)}" if exponent else mantissa


def decode(type_name: str, data: bytes) -> Any:
    """Decode a message; raises CodecError on XML that is not a message of that type."""
    node = message_node(type_name)
    try:
        root = _parse_xml(bytes(data))
        if root.tag != node.name:
            raise CodecError(f"element <{root.tag[:60]}>: expected <{node.name}>")
        return _value(root, node, node.name)
    except InputError as error:
        raise CodecError(f"{node.name} as xer, {len(data)} bytes: {error}") from error


class _Builder(ElementTree.TreeBuilder):
    """Builder of a tree of bounded depth from a document without a DTD."""

    def __init__(self) -> None:
        super().__init__()
        self._depth = 0

    def doctype(self, name: str, pubid: str | None, system: str | None) -> None:
        raise CodecError("the document has a DTD: expected none")

    def start(self, tag: Any, attrs: Any, /) -> Any:
        self._depth += 1
        if self._depth > _MAX_DEPTH:
            raise CodecError(f"elements are nested more than {_MAX_DEPTH} deep")
        return super().start(tag, attrs)

    def end(self, tag: Any, /) -> Any:
        self._depth -= 1
        return super().end(tag)


def _parse_xml(data: bytes) -> ElementTree.Element:
    """Return the root of a document without DTD, comments and CDATA; raises CodecError."""
    if b"<!" in data:
        raise CodecError("the document has a DTD, comment or CDATA: expected elements and text only")
    parser = ElementTree.XMLParser(target=_Builder())
    try:
        parser.feed(data)
        root: ElementTree.Element = parser.close()
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise CodecError(f"not XML: {error}") from error
    return root


def _value(element: ElementTree.Element, node: Node | Alias, where: str) -> Any:
    """Return the value of a node from its XML element; raises CodecError with the path ``where``."""
    match node:
        case Struct():
            children = list(element)
            if [c.tag for c in children] != [f.name for f in node.fields]:
                names = ", ".join(f.name for f in node.fields)
                raise CodecError(f"{where}: {', '.join(c.tag for c in children)[:120]}: expected {names}")
            values = [
                _value(c, f.node, f"{where}.{f.name}") for c, f in zip(children, node.fields, strict=True)
            ]
            return class_of(node.class_name)(*values)
        case Alias():
            return class_of(node.class_name)(_value(element, node.node, where))
        case Array():
            return _array(element, node, where)
        case ListOf():
            return tuple(_value(c, node.element, f"{where}[{i}]") for i, c in enumerate(element))
        case OctetString():
            return array_of_bytes(_octets(element, where), node)
        case Text():
            return _octets(element, where).decode("utf-8", "surrogateescape")
        case Enumeration():
            members = dict(node.members)
            name = element[0].tag if len(element) == 1 else (element.text or "").strip()
            if name not in members:
                raise CodecError(f"{where}={name[:60]!r}: expected one of {', '.join(members)}")
            return class_of(node.class_name)(members[name])
        case Choice():
            for field in node.alternatives:
                if len(element) == 1 and element[0].tag == field.name:
                    value = _value(element[0], field.node, f"{where}.{field.name}")
                    return class_of(node.class_name)(field.attribute, value)
            raise CodecError(f"{where}: expected one of {', '.join(f.name for f in node.alternatives)}")
        case Real():
            return _real(element, where)
        case Boolean():
            return _boolean(element[0].tag if len(element) == 1 else (element.text or "").strip(), where)
        case Integer():
            return _integer(element, where)


def _array(element: ElementTree.Element, node: Array, where: str) -> Any:
    """Return an array from nested XML elements."""

    def nested_lists(parent: ElementTree.Element, depth: int) -> list[Any]:
        if depth:
            return [nested_lists(child, depth - 1) for child in parent]
        if isinstance(node.element, Boolean):
            return [_boolean(child.tag, where) for child in parent]
        leaf = _real if isinstance(node.element, Real) else _integer
        return [leaf(child, where) for child in parent]

    values = nested_lists(element, len(node.dims) - 1)
    if not values:
        return np.zeros((0, *(low for low, _ in node.dims[1:])), dtype=node.dtype)
    try:
        return np.array(values, dtype=node.dtype)
    except (ValueError, OverflowError) as error:
        raise CodecError(f"{where}: expected numbers of the type's range in rows of one size") from error


def _real(element: ElementTree.Element, where: str) -> float:
    """Return the real number of an element, which may be infinite or NaN."""
    if len(element) == 1 and element[0].tag in _SPECIAL:
        return _SPECIAL[element[0].tag]
    text = (element.text or "").strip()
    if text in _SPECIAL_TEXT:
        return _SPECIAL_TEXT[text]
    if len(element) or not _REAL.match(text):
        raise CodecError(f"{where}={text[:60]!r}: expected a real number")
    return float(text)


def _integer(element: ElementTree.Element, where: str) -> int:
    text = (element.text or "").strip()
    if len(element) or not _INTEGER.match(text):
        raise CodecError(f"{where}={text[:60]!r}: expected an integer")
    return int(text)


def _boolean(name: str, where: str) -> bool:
    if name not in ("true", "false"):
        raise CodecError(f"{where}={name[:60]!r}: expected true or false")
    return name == "true"


def _octets(element: ElementTree.Element, where: str) -> bytes:
    if len(element):
        raise CodecError(f"{where}: elements, expected hexadecimal digits")
    try:
        return bytes.fromhex(element.text or "")
    except ValueError as error:
        raise CodecError(f"{where}: expected pairs of hexadecimal digits") from error

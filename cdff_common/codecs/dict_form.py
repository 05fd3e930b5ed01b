# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Dict form of a message: nested maps and lists as in the logs of InFuse (Fig. 4 of the paper).

Field names are those of the ASN.1 modules with ``_`` for ``-``; enumerations are their names, e.g.
``depth_8U``; matrices are nested lists. ``from_dict_form`` also reads the variants of real InFuse logs:
snake_case names, lists of numbers for bytes, enumerations as numbers, missing fields, ``timestamp`` for
``ref_time`` and the reverse. Missing fields get their default; ``on_quirk`` is called for each such quirk.
Unknown fields are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cdff_common.codecs.wire_types import array_of_bytes, message_node
from cdff_common.errors import CodecError, InputError
from cdff_common.types.schema import (
    Alias,
    Array,
    Choice,
    Enumeration,
    Field,
    ListOf,
    Node,
    OctetString,
    Struct,
    Text,
)
from cdff_common.types.validation import class_of

Quirk = Callable[[str], None]
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
#: Interchangeable names of the time of a sample, in pocolog and in InFuse.
_TWINS = {"timestamp": "ref_time", "ref_time": "timestamp", "time_stamp": "timestamp"}


def to_dict_form(value: Any) -> Any:
    """Return a message as nested dicts, lists, numbers, text and bytes."""
    return dict_form_of(value, message_node(type(value).ASN1_NAME))


def dict_form_of(value: Any, node: Node | Alias, *, asn1tools: bool = False) -> Any:
    """Return the dict form of the value of a node, or the value that asn1tools encodes."""
    match node:
        case Struct():
            return {
                f.name if asn1tools else f.key: dict_form_of(
                    getattr(value, f.attribute), f.node, asn1tools=asn1tools
                )
                for f in node.fields
            }
        case Alias():
            return dict_form_of(getattr(value, node.attribute), node.node, asn1tools=asn1tools)
        case Array():
            return value.tolist()
        case ListOf():
            return [dict_form_of(v, node.element, asn1tools=asn1tools) for v in value]
        case OctetString():
            return value.tobytes()
        case Text() if asn1tools:
            return value.encode("utf-8", "surrogateescape")
        case Enumeration():
            name = next(n for n, v in node.members if v == value)
            return name if asn1tools else name.replace("-", "_")
        case Choice():
            field = next(f for f in node.alternatives if f.attribute == value.kind)
            content = dict_form_of(value.value, field.node, asn1tools=asn1tools)
            return (field.name, content) if asn1tools else {field.key: content}
        case _:
            return value


def from_dict_form(type_name: str, obj: Any, on_quirk: Quirk | None = None) -> Any:
    """Return the message of a dict form.

    Parameters
    ----------
    type_name : str
        ASN.1 name or class name.
    obj : Any
        Result of ``to_dict_form``, a sample of an InFuse log, or a value decoded by asn1tools.
    on_quirk : callable, optional
        Called with a short text for each accepted deviation.

    Raises
    ------
    CodecError
        If ``obj`` is not of that type; the message names the field.
    """
    node = message_node(type_name)
    try:
        return _from_dict_form(obj, node, node.name, on_quirk or _ignore)
    except InputError as error:
        if isinstance(error, CodecError):
            raise
        raise CodecError(f"{node.name}: {error}") from error


def _ignore(quirk: str) -> None:
    """Ignore a quirk."""


def _from_dict_form(obj: Any, node: Node | Alias, where: str, quirk: Quirk) -> Any:
    """Return the value of a node from its dictionary form; raises CodecError with the path ``where``."""
    match node:
        case Struct():
            return _struct(obj, node, where, quirk)
        case Alias():
            return class_of(node.class_name)(_from_dict_form(obj, node.node, where, quirk))
        case Array():
            return _array(obj, node, where)
        case ListOf():
            if not isinstance(obj, list | tuple):
                raise CodecError(f"{where}: a {type(obj).__name__}, expected a list")
            return tuple(_from_dict_form(v, node.element, f"{where}[{i}]", quirk) for i, v in enumerate(obj))
        case OctetString():
            return _octets(obj, node, where, quirk)
        case Text():
            if isinstance(obj, bytes):
                quirk(f"{where}: bytes for text")
                return obj.decode("utf-8", "surrogateescape")
            return obj
        case Enumeration():
            return _enumeration(obj, node, where, quirk)
        case Choice():
            return _choice(obj, node, where, quirk)
        case _:
            return obj


def _struct(obj: Any, node: Struct, where: str, quirk: Quirk) -> Any:
    """Return a structure from a map of its fields; other spellings are accepted as quirks."""
    if not isinstance(obj, Mapping):
        raise CodecError(f"{where}: a {type(obj).__name__}, expected a map of {node.name}'s fields")
    entries = dict(obj)
    values: dict[str, Any] = {}
    missing: list[Field] = []
    for field in node.fields:
        key = field.key if field.key in entries else _other_spelling(field, entries)
        if key is None:
            missing.append(field)
            continue
        values[field.attribute] = _from_dict_form(entries.pop(key), field.node, f"{where}.{field.key}", quirk)
    for field in missing:
        twin = _TWINS.get(field.attribute)
        if twin in entries:
            quirk(f"{where}: {twin} read as {field.key}")
            values[field.attribute] = _from_dict_form(
                entries.pop(twin), field.node, f"{where}.{field.key}", quirk
            )
        else:
            quirk(f"{where}.{field.key}: missing, default used")
    if entries:
        names = ", ".join(f.key for f in node.fields)
        raise CodecError(f"{where}: unknown field {sorted(map(str, entries))[0]!r}, expected {names}")
    return class_of(node.class_name)(**values)


def _other_spelling(field: Field, entries: Mapping[Any, Any]) -> str | None:
    """Return the key of a field in snake_case or with dashes, or None."""
    for name in (field.name, field.attribute):
        if name in entries:
            return name
    for name in entries:
        if isinstance(name, str) and _CAMEL.sub("_", name.replace("-", "_")).lower() == field.attribute:
            return name
    return None


def _array(obj: Any, node: Array, where: str) -> Any:
    """Return an array from nested lists of numbers."""
    if isinstance(obj, np.ndarray):
        return obj
    dtype = node.dtype
    try:
        array = np.array(obj)
    except (ValueError, TypeError, OverflowError) as error:
        raise CodecError(f"{where}: expected nested lists of numbers of one shape ({error})") from error
    if array.size and array.dtype.kind not in ("b" if dtype.kind == "b" else "fiu"):
        raise CodecError(
            f"{where}: expected nested lists of {'booleans' if dtype.kind == 'b' else 'numbers'}"
        )
    return array


def _octets(obj: Any, node: OctetString, where: str, quirk: Quirk) -> Any:
    """Return an octet string from bytes or, as a quirk, from a list of numbers."""
    if isinstance(obj, list | np.ndarray):
        quirk(f"{where}: list of numbers for bytes")
        try:
            obj = bytes(obj) if isinstance(obj, list) else obj.tobytes()
        except (ValueError, TypeError) as error:
            raise CodecError(f"{where}: expected bytes ({error})") from error
    if not isinstance(obj, bytes | bytearray | memoryview):
        raise CodecError(f"{where}: a {type(obj).__name__}, expected bytes")
    return array_of_bytes(obj, node)


def _enumeration(obj: Any, node: Enumeration, where: str, quirk: Quirk) -> Any:
    """Return an enumeration value from its name or, as a quirk, from its number."""
    if isinstance(obj, str):
        for name, value in node.members:
            if obj.replace("_", "-").lower() == name.lower():
                return class_of(node.class_name)(value)
    elif isinstance(obj, int) and not isinstance(obj, bool) and obj in [v for _, v in node.members]:
        quirk(f"{where}: number for an enumeration")
        return class_of(node.class_name)(obj)
    names = ", ".join(n.replace("-", "_") for n, _ in node.members)
    raise CodecError(f"{where}={obj!r}: expected one of {names}")


def _choice(obj: Any, node: Choice, where: str, quirk: Quirk) -> Any:
    """Return a choice from a pair, or from a map with one key, the name of the alternative."""
    is_pair = isinstance(obj, tuple) and len(obj) == 2
    pairs = [obj] if is_pair else list(obj.items()) if isinstance(obj, Mapping) else []
    for key, content in pairs if len(pairs) == 1 else ():
        for field in node.alternatives:
            if key in (field.key, field.attribute, field.name):
                value = _from_dict_form(content, field.node, f"{where}.{field.key}", quirk)
                return class_of(node.class_name)(field.attribute, value)
    raise CodecError(f"{where}: expected a map of one of {', '.join(f.key for f in node.alternatives)}")

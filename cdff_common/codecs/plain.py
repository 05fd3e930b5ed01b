# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The plain form of a message: nested maps and lists as in the logs of InFuse (Fig. 4 of the paper).

Field names are those of the ASN.1 modules with ``_`` for ``-``; enumerations are their names, as ``depth_8U``;
matrices nested lists; octets bytes. ``from_plain`` also reads what real InFuse logs hold: snake_case names, lists
of numbers for octets, enumerations as numbers, fields left out, ``timestamp`` for ``ref_time`` and the reverse.
Fields left out take their default; each such quirk is told to ``on_quirk``. Unknown fields are refused.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from cdff_common.codecs.bridge import array_dtype, class_of, message_node, octets_as_array
from cdff_common.codecs.schema import (
    Alias,
    Array,
    Choice,
    Enumeration,
    Field,
    ListOf,
    Node,
    Octets,
    Struct,
    Text,
)
from cdff_common.errors import CodecError, InputError

Quirk = Callable[[str], None]
_CAMEL = re.compile(r"(?<=[a-z0-9])(?=[A-Z])")
#: Names that stand for each other where only one is there: pocolog's and InFuse's time of a sample.
_TWINS = {"timestamp": "ref_time", "ref_time": "timestamp", "time_stamp": "timestamp"}


def to_plain(value: Any) -> Any:
    """Nested dicts, lists, numbers, text and bytes of a message."""
    return plain_of(value, message_node(type(value).ASN1_NAME))


def plain_of(value: Any, node: Node | Alias) -> Any:
    """Plain form of the value of a node."""
    match node:
        case Struct():
            return {f.key: plain_of(getattr(value, f.attribute), f.node) for f in node.fields}
        case Alias():
            return plain_of(getattr(value, node.attribute), node.node)
        case Array():
            return value.tolist()
        case ListOf():
            return [plain_of(v, node.element) for v in value]
        case Octets():
            return value.tobytes()
        case Enumeration():
            return next(n for n, v in node.members if v == value).replace("-", "_")
        case Choice():
            field = next(f for f in node.alternatives if f.attribute == value.kind)
            return {field.key: plain_of(value.value, field.node)}
        case _:
            return value


def from_plain(type_name: str, obj: Any, on_quirk: Quirk | None = None) -> Any:
    """Message of a plain form.

    Parameters
    ----------
    type_name : str
        ASN.1 name or class name.
    obj : Any
        What ``to_plain`` gives, or a sample of an InFuse log.
    on_quirk : callable, optional
        Called with a short text for each deviation that was read all the same.

    Raises
    ------
    CodecError
        If ``obj`` is not of that type; the message names the field.
    """
    node = message_node(type_name)
    try:
        return _from_plain(obj, node, node.name, on_quirk or _ignore)
    except InputError as error:
        if isinstance(error, CodecError):
            raise
        raise CodecError(f"{node.name}: {error}") from error


def _ignore(quirk: str) -> None:
    """No report."""


def _from_plain(obj: Any, node: Node | Alias, where: str, quirk: Quirk) -> Any:
    match node:
        case Struct():
            return _struct(obj, node, where, quirk)
        case Alias():
            return class_of(node.class_name)(_from_plain(obj, node.node, where, quirk))
        case Array():
            return _array(obj, node, where)
        case ListOf():
            if not isinstance(obj, list | tuple):
                raise CodecError(f"{where}: a {type(obj).__name__}, expected a list")
            return tuple(_from_plain(v, node.element, f"{where}[{i}]", quirk) for i, v in enumerate(obj))
        case Octets():
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
    if not isinstance(obj, Mapping):
        raise CodecError(f"{where}: a {type(obj).__name__}, expected a map of {node.name}'s fields")
    given = dict(obj)
    found: dict[str, Any] = {}
    missing: list[Field] = []
    for field in node.fields:
        key = field.key if field.key in given else _other_spelling(field, given)
        if key is None:
            missing.append(field)
            continue
        found[field.attribute] = _from_plain(given.pop(key), field.node, f"{where}.{field.key}", quirk)
    for field in missing:
        twin = _TWINS.get(field.attribute)
        if twin in given:
            quirk(f"{where}: {twin} read as {field.key}")
            found[field.attribute] = _from_plain(given.pop(twin), field.node, f"{where}.{field.key}", quirk)
        else:
            quirk(f"{where}.{field.key}: left out, default taken")
    if given:
        names = ", ".join(f.key for f in node.fields)
        raise CodecError(f"{where}: unknown field {sorted(map(str, given))[0]!r}, expected {names}")
    return class_of(node.class_name)(**found)


def _other_spelling(field: Field, given: Mapping[Any, Any]) -> str | None:
    """Key of a field that is written in snake_case or with dashes."""
    for name in (field.name, field.attribute):
        if name in given:
            return name
    for name in given:
        if isinstance(name, str) and _CAMEL.sub("_", name.replace("-", "_")).lower() == field.attribute:
            return name
    return None


def _array(obj: Any, node: Array, where: str) -> Any:
    if isinstance(obj, np.ndarray):
        return obj
    dtype = array_dtype(node)
    try:
        array = np.array(obj)
    except (ValueError, TypeError, OverflowError) as error:
        raise CodecError(f"{where}: expected nested lists of numbers of one shape ({error})") from error
    if array.size and array.dtype.kind not in ("b" if dtype.kind == "b" else "fiu"):
        raise CodecError(f"{where}: expected nested lists of {'booleans' if dtype.kind == 'b' else 'numbers'}")
    return array


def _octets(obj: Any, node: Octets, where: str, quirk: Quirk) -> Any:
    if isinstance(obj, list | np.ndarray):
        quirk(f"{where}: list of numbers for octets")
        try:
            obj = bytes(obj) if isinstance(obj, list) else obj.tobytes()
        except (ValueError, TypeError) as error:
            raise CodecError(f"{where}: expected bytes ({error})") from error
    if not isinstance(obj, bytes | bytearray | memoryview):
        raise CodecError(f"{where}: a {type(obj).__name__}, expected bytes")
    return octets_as_array(obj, node)


def _enumeration(obj: Any, node: Enumeration, where: str, quirk: Quirk) -> Any:
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
    if isinstance(obj, Mapping) and len(obj) == 1:
        ((key, content),) = obj.items()
        for field in node.alternatives:
            if key in (field.key, field.attribute, field.name):
                value = _from_plain(content, field.node, f"{where}.{field.key}", quirk)
                return class_of(node.class_name)(field.attribute, value)
    raise CodecError(f"{where}: expected a map of one of {', '.join(f.key for f in node.alternatives)}")

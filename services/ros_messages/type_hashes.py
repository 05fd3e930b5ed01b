# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Hashes of message and service types of ROS 2: RIHS01 of REP 2016.

The hash is SHA-256 of a canonical JSON text of the type and of all types that it contains. That of rosbags
differs for types with a member of the type ``char``, which is ``uint8`` in ROS 2.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import get_types_from_msg

#: Numbers of ``type_description_interfaces/msg/FieldType``.
_NESTED, _BOUNDED_STRING = 1, 21
_NUMBERS = {
    "int8": 2,
    "uint8": 3,
    "char": 3,
    "int16": 4,
    "uint16": 5,
    "int32": 6,
    "uint32": 7,
    "int64": 8,
    "uint64": 9,
    "float32": 10,
    "float64": 11,
    "bool": 15,
    "byte": 16,
    "octet": 16,
    "string": 17,
}
_ARRAY, _BOUNDED_SEQUENCE, _SEQUENCE = 48, 96, 144
#: Member of types that have none.
_NO_MEMBER = ("structure_needs_at_least_one_member", (Nodetype.BASE, ("uint8", 0)))
_SERVICE_EVENT = "service_msgs/msg/ServiceEventInfo"

#: Definitions of rosbags by type: constants, and members with their type.
Definitions = Mapping[str, Any]
Description = dict[str, Any]


def message_hash(definitions: Definitions, name: str) -> str:
    """Return the hash of a message type.

    Parameters
    ----------
    definitions : mapping
        ``fielddefs`` of a type store of rosbags.
    name : str
        Such as ``std_msgs/msg/String``.
    """
    return _hash(name, _descriptions(definitions, (name,)))


def service_hash(
    definitions: Definitions, name: str, definition: str, parts: tuple[str, str] | None = None
) -> str:
    """Return the hash of a service type.

    Parameters
    ----------
    definitions : mapping
        ``fielddefs`` of a type store of rosbags, with ``service_msgs/msg/ServiceEventInfo``.
    name : str
        Such as ``std_srvs/srv/SetBool``.
    definition : str
        Text of the ``.srv`` file: request, a line of three hyphens, response.
    parts : tuple of str, optional
        Names of request and response in ``definitions``, instead of the text.
    """
    own: dict[str, Any] = {}
    if parts is None:
        request, _, response = f"{definition}\n".partition("---\n")
        package, _, last = name.split("/")
        for suffix, text in (("Request", request), ("Response", response)):
            parsed: Definitions = get_types_from_msg(text, f"{package}/msg/{last}_{suffix}")
            own[f"{name}_{suffix}"] = parsed[f"{package}/msg/{last}_{suffix}"]
        parts = (f"{name}_Request", f"{name}_Response")
    descriptions = _descriptions({**definitions, **own}, (*parts, _SERVICE_EVENT))
    ends = dict(zip(("request", "response"), parts, strict=True))
    event = f"{name}_Event"
    descriptions[event] = _description(
        event,
        _field("info", _NESTED, nested=_SERVICE_EVENT),
        *(_field(end, _BOUNDED_SEQUENCE + _NESTED, capacity=1, nested=ends[end]) for end in ends),
    )
    descriptions[name] = _description(
        name,
        *(_field(f"{end}_message", _NESTED, nested=ends[end]) for end in ends),
        _field("event_message", _NESTED, nested=event),
    )
    return _hash(name, descriptions)


def _hash(name: str, descriptions: dict[str, Description]) -> str:
    others = [descriptions[other] for other in sorted(descriptions) if other != name]
    text = json.dumps({"type_description": descriptions[name], "referenced_type_descriptions": others})
    return f"RIHS01_{hashlib.sha256(text.encode()).hexdigest()}"


def _descriptions(definitions: Definitions, names: tuple[str, ...]) -> dict[str, Description]:
    """Return the descriptions of types and of all types that they contain."""
    found: dict[str, Description] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        if name not in found:
            members = definitions[name][1] or [_NO_MEMBER]
            found[name] = _description(name, *(_member(member, kind) for member, kind in members))
            nested = (field["type"]["nested_type_name"] for field in found[name]["fields"])
            waiting += [n for n in nested if n]
    return found


def _description(name: str, *members: Description) -> Description:
    return {"type_name": name, "fields": list(members)}


def _member(name: str, kind: Any) -> Description:
    increment = capacity = 0
    if kind[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
        is_array = kind[0] == Nodetype.ARRAY
        kind, capacity = kind[1]
        increment = _ARRAY if is_array else _BOUNDED_SEQUENCE if capacity else _SEQUENCE
    node, content = kind
    if node == Nodetype.NAME:
        return _field(name, increment + _NESTED, capacity=capacity, nested=content)
    base, limit = content
    if base == "string" and limit:
        return _field(name, increment + _BOUNDED_STRING, capacity=capacity, string_capacity=limit)
    return _field(name, increment + _NUMBERS[base], capacity=capacity)


def _field(
    name: str, number: int, *, capacity: int = 0, string_capacity: int = 0, nested: str = ""
) -> Description:
    kind = {
        "type_id": number,
        "capacity": capacity or 0,
        "string_capacity": string_capacity,
        "nested_type_name": nested,
    }
    return {"name": name, "type": kind}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Message types of ROS 2 for Cyclone DDS, whose messages stay in CDR.

Other implementations compare the structure of a type, so that it is declared in full; the messages themselves
are encoded and decoded by rosbags, as in the other gateways.
"""

from __future__ import annotations

from typing import Any

from cyclonedds.idl import make_idl_struct
from cyclonedds.idl import types as idl
from rosbags.interfaces import Nodetype

from services.gateway_ros2.rmw_zenoh import dds_type
from services.ros_messages.message_types import RosTypes

_NUMBERS = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "int64", "uint64", "float32", "float64")
_BASIC: dict[str, Any] = {
    "bool": bool,
    "string": str,
    "byte": idl.uint8,
    "octet": idl.uint8,
    "char": idl.uint8,
    **{name: getattr(idl, name) for name in _NUMBERS},
}


class RawTypes:
    """Types of Cyclone DDS by the names of ROS 2."""

    def __init__(self, types: RosTypes) -> None:
        self._types = types
        self._structures: dict[str, Any] = {}
        self._raw: dict[str, Any] = {}

    def of(self, type_name: str) -> Any:
        """Return the type of a topic: a class whose objects hold the bytes of a message as ``data``."""
        if type_name not in self._raw:
            self._raw[type_name] = _raw_type(self._structure(type_name))
        return self._raw[type_name]

    def _structure(self, type_name: str) -> Any:
        if type_name not in self._structures:
            members = self._types.store.fielddefs[type_name][1]
            fields = {name: self._field(description) for name, description in members}
            name = f"{type_name.rpartition('/')[2]}_"
            self._structures[type_name] = make_idl_struct(name, dds_type(type_name), fields)
        return self._structures[type_name]

    def _field(self, description: Any) -> Any:
        kind, value = description
        if kind == Nodetype.BASE:
            name, bound = value
            return idl.bounded_str[bound] if name == "string" and bound else _BASIC[name]
        if kind == Nodetype.NAME:
            return self._structure(value)
        element, bound = self._field(value[0]), value[1]
        if kind == Nodetype.ARRAY:
            return idl.array[element, bound]
        return idl.sequence[element, bound] if bound else idl.sequence[element]


def _raw_type(structure: Any) -> Any:
    """Return a type with the structure of another, whose messages are bytes."""

    class Raw(structure):  # type: ignore[misc]
        """Encoded message."""

        def __init__(self, data: bytes) -> None:
            self.data = data

        def serialize(self, **_: Any) -> bytes:
            return self.data

        def serialize_key(self, **_: Any) -> bytes:
            return b""

        @classmethod
        def deserialize(cls, data: bytes, **_: Any) -> Raw:
            return cls(bytes(data))

    Raw.__idl__, Raw.__idl_typename__ = structure.__idl__, structure.__idl_typename__
    return Raw

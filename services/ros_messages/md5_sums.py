# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MD5 sums of message and service types of ROS 1, as ``genmsg`` computes them; they are no protection."""

from __future__ import annotations

import hashlib
from typing import Any

from rosbags.interfaces import Nodetype

from services.ros_messages.message_types import BITSTREAM, RosTypes

_TIMES = {"builtin_interfaces/msg/Time": "time", "builtin_interfaces/msg/Duration": "duration"}
#: Names of ROS 1 that differ in ROS 2.
_WIRE_NAMES = {BITSTREAM: "infuse_msgs/asn1_bitstream"}


def wire_name(type_name: str) -> str:
    """Return the name of a type in ROS 1: ``sensor_msgs/msg/Imu`` is ``sensor_msgs/Imu``."""
    return _WIRE_NAMES.get(type_name) or type_name.replace("/msg/", "/").replace("/srv/", "/")


def message_md5(types: RosTypes, type_name: str) -> str:
    """Return the sum of a message type."""
    return types.store.generate_msgdef(type_name)[1]


def service_md5(types: RosTypes, request: str, response: str) -> str:
    """Return the sum of a service type by the names of its request and response in the type store."""
    text = _hash_text(types, request) + _hash_text(types, response)
    return hashlib.md5(text.encode(), usedforsecurity=False).hexdigest()


def _hash_text(types: RosTypes, type_name: str) -> str:
    """Return the text whose MD5 is the sum: nested types have their sum in place of their name."""
    constants, members = types.store.fielddefs[type_name]
    lines = [f"{kind} {name}={value}" for name, kind, value in constants]
    return "\n".join(
        lines + [f"{_kind_text(types, kind)} {name}" for name, kind in members if name[:9] != "structure"]
    )


def _kind_text(types: RosTypes, kind: Any) -> str:
    node, content = kind
    if node == Nodetype.BASE:
        return str(content[0])
    if node == Nodetype.NAME:
        return _TIMES.get(content) or message_md5(types, content)
    inner, count = content
    text = _kind_text(types, inner)
    is_nested = inner[0] == Nodetype.NAME and inner[1] not in _TIMES
    return text if is_nested else f"{text}[{count or ''}]"

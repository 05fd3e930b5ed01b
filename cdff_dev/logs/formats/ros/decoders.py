# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoders of messages by the encodings of message and schema: ROS 1, ROS 2, protobuf and JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore

from cdff_common.errors import InputError

#: Returns the message of encoded bytes.
Decoder = Callable[[bytes], Any]
#: Types are names in Python code that rosbags generates.
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}")
_IDL_SEPARATOR = "=" * 80 + "\n"
_MAX_SCHEMA_BYTES = 4 << 20


def decoder(message_encoding: str, schema_encoding: str, name: str, schema: bytes) -> Decoder:
    """Return the decoder of a channel.

    Parameters
    ----------
    message_encoding, schema_encoding : str
        As named by the registry of MCAP (https://mcap.dev/spec/registry).
    name : str
        Name of the schema, the type of the messages.
    schema : bytes

    Raises
    ------
    InputError
        If the encodings are not supported, or the schema has another name.
    """
    if len(schema) > _MAX_SCHEMA_BYTES:
        raise InputError(f"schema of {len(schema)} bytes, expected at most {_MAX_SCHEMA_BYTES}")
    encodings = (message_encoding, schema_encoding)
    if encodings in (("ros1", "ros1msg"), ("cdr", "ros2msg"), ("cdr", "ros2idl")):
        return _ros_decoder(message_encoding, schema_encoding, ros_type(name), schema.decode("utf-8"))
    if encodings == ("protobuf", "protobuf"):
        return _protobuf_decoder(name, schema)
    if encodings == ("json", "jsonschema"):
        return _from_json
    raise InputError(
        f"messages in {message_encoding!r} with a schema in {schema_encoding!r}, expected ROS 1, CDR with a "
        "schema, protobuf or JSON"
    )


def ros_type(name: str) -> str:
    """Return the name of a type as in ROS 2; raises InputError if it is none."""
    if not _TYPE_NAME.fullmatch(name):
        raise InputError(
            f"type {name[:80]!r}, expected the name of a type of ROS such as std_msgs/msg/String"
        )
    package, _, last = name.partition("/")
    return name if "/" in last else f"{package}/msg/{last}"


def _ros_decoder(encoding: str, schema_encoding: str, name: str, schema: str) -> Decoder:
    types: dict[str, Any] = {}
    if schema_encoding != "ros2idl":
        types.update(get_types_from_msg(schema, name))
    elif schema.startswith(f"{_IDL_SEPARATOR}IDL: "):
        for part in schema.split(_IDL_SEPARATOR)[1:]:
            types.update(get_types_from_idl(part.partition("\n")[2]))
    else:
        types.update(get_types_from_idl(schema))
    for found in types:
        ros_type(found)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    decode = store.deserialize_ros1 if encoding == "ros1" else store.deserialize_cdr
    return lambda raw: decode(raw, name)


def _protobuf_decoder(name: str, schema: bytes) -> Decoder:
    from google.protobuf.descriptor_pb2 import FileDescriptorSet  # type: ignore[import-untyped]
    from google.protobuf.descriptor_pool import DescriptorPool  # type: ignore[import-untyped]
    from google.protobuf.message_factory import GetMessageClass  # type: ignore[import-untyped]

    pool = DescriptorPool()
    waiting = {file.name: file for file in FileDescriptorSet.FromString(schema).file}
    while waiting:
        ready = [f for f in waiting.values() if not any(other in waiting for other in f.dependency)]
        if not ready:
            raise InputError(f"schema of {name}: files that include each other: {', '.join(waiting)}")
        for file in ready:
            pool.Add(waiting.pop(file.name))
    decode: Decoder = GetMessageClass(pool.FindMessageTypeByName(name)).FromString
    return decode


class _JsonObject(SimpleNamespace):
    """An object whose fields are attributes."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"no field {name!r} in an object with {', '.join(self.__dict__)}")


def _from_json(raw: bytes) -> Any:
    return json.loads(raw, object_hook=lambda fields: _JsonObject(**fields))

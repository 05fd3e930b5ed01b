# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoders of messages by the encodings of message and schema: ROS 1, ROS 2, protobuf and JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import lru_cache
from types import SimpleNamespace
from typing import Any

from google.protobuf.message import DecodeError  # type: ignore[import-untyped]
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_idl, get_types_from_msg, get_typestore

from cdff_common.errors import InputError
from cdff_dev.logs.formats.ros.recording import PARSER_ERRORS, Encoded

#: Function that decodes the bytes of a message.
Decoder = Callable[[Encoded], Any]
#: Errors of damaged schemas and messages.
DECODER_ERRORS = (*PARSER_ERRORS, InputError, DecodeError, SerdeError, TypesysError)
#: Valid name of a type: rosbags generates Python code in which types are identifiers.
_TYPE_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}")
_IDL_SEPARATOR = "=" * 80 + "\n"
_MAX_SCHEMA_BYTES = 4 << 20


@lru_cache(maxsize=256)
def decoder(
    message_encoding: str, schema_encoding: str, name: str, schema: bytes, digest: str = ""
) -> Decoder:
    """Return the decoder of a channel; decoders are kept, since files of a robot have the same types.

    Parameters
    ----------
    message_encoding, schema_encoding : str
        As named by the registry of MCAP (https://mcap.dev/spec/registry).
    name : str
        Name of the schema, the type of the messages.
    schema : bytes
    digest : str, optional
        MD5 sum of ROS 1 or hash of ROS 2 (REP-2011) of the schema, which is compared with it.

    Raises
    ------
    InputError
        If the encodings are not supported, or the schema has another name or digest.
    """
    if len(schema) > _MAX_SCHEMA_BYTES:
        raise InputError(f"schema of {len(schema)} bytes, expected at most {_MAX_SCHEMA_BYTES}")
    encodings = (message_encoding, schema_encoding)
    if encodings in (("ros1", "ros1msg"), ("cdr", "ros2msg"), ("cdr", "ros2idl")):
        text = schema.decode("utf-8")
        return _ros_decoder(message_encoding, schema_encoding, ros_type(name), text, digest)
    if encodings == ("protobuf", "protobuf"):
        return _protobuf_decoder(name, schema)
    if encodings == ("json", "jsonschema"):
        return _from_json
    raise InputError(
        f"messages in {message_encoding!r} with a schema in {schema_encoding!r}, expected ROS 1, CDR with a "
        "schema, protobuf or JSON"
    )


def ros_type(name: str) -> str:
    """Return the name of a type in the form of ROS 2; raises InputError if the text is no type name."""
    if not _TYPE_NAME.fullmatch(name):
        raise InputError(
            f"type {name[:80]!r}, expected the name of a type of ROS such as std_msgs/msg/String"
        )
    package, _, last = name.partition("/")
    return name if "/" in last else f"{package}/msg/{last}"


def decoder_or_fault(create: Callable[[], Decoder]) -> Decoder | str:
    """Return the decoder that ``create`` returns, or the text of the error that it raises."""
    try:
        return create()
    except DECODER_ERRORS as error:
        return f"{error}" if isinstance(error, InputError) else f"schema: {type(error).__name__}: {error}"


@lru_cache(maxsize=256)
def standard_decoder(name: str) -> Decoder:
    """Return the decoder of a standard type of ROS 2, for bags without schemas (before ROS 2 Iron).

    Raises InputError for other types.
    """
    store = get_typestore(Stores.ROS2_HUMBLE)
    if name not in store.fielddefs:
        raise InputError(
            f"the bag does not define {name}, which is no standard type: record it with ROS 2 Iron or later, "
            "or convert it there"
        )
    return lambda raw: store.deserialize_cdr(raw, name)


def _ros_decoder(encoding: str, schema_encoding: str, name: str, schema: str, digest: str) -> Decoder:
    types: dict[str, Any] = {}
    if schema_encoding != "ros2idl":
        types.update(get_types_from_msg(schema, name))
    elif schema.startswith(f"{_IDL_SEPARATOR}IDL: "):
        for part in schema.split(_IDL_SEPARATOR)[1:]:
            types.update(get_types_from_idl(part.partition("\n")[2]))
    else:
        types.update(get_types_from_idl(schema))
    for type_name in types:
        ros_type(type_name)
    store = get_typestore(Stores.EMPTY)
    store.register(types)
    if digest:
        found_digest = store.generate_msgdef(name)[1] if encoding == "ros1" else store.hash_rihs01(name)
        if found_digest != digest:
            raise InputError(f"schema of {name} with digest {found_digest}, expected {digest}")
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
    message = GetMessageClass(pool.FindMessageTypeByName(name))
    decode: Decoder = message.FromString
    return decode


class _JsonObject(SimpleNamespace):
    """An object whose fields are attributes."""

    def __getattr__(self, name: str) -> Any:
        raise AttributeError(f"no field {name!r} in an object with {', '.join(self.__dict__)}")


def _from_json(raw: Encoded) -> Any:
    return json.loads(bytes(raw), object_hook=lambda fields: _JsonObject(**fields))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Foxglove's schemas: the names and numbers of their fields, as protobuf classes and as JSON schemas.

Fields that are never written are left out: readers see them unset. Reference:
https://docs.foxglove.dev/docs/sdk/schemas
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np
from google.protobuf import timestamp_pb2  # type: ignore[import-untyped]
from google.protobuf.descriptor_pb2 import (  # type: ignore[import-untyped]
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
    FileDescriptorSet,
)
from google.protobuf.descriptor_pool import DescriptorPool  # type: ignore[import-untyped]
from google.protobuf.message_factory import GetMessageClass  # type: ignore[import-untyped]

PACKAGE = "foxglove"
_SCHEMAS = """
message Vector3 { double x = 1; double y = 2; double z = 3; }
message Quaternion { double x = 1; double y = 2; double z = 3; double w = 4; }
message Pose { Vector3 position = 1; Quaternion orientation = 2; }
message PackedElementField {
  enum NumericType {
    UNKNOWN = 0; UINT8 = 1; INT8 = 2; UINT16 = 3; INT16 = 4; UINT32 = 5; INT32 = 6; FLOAT32 = 7; FLOAT64 = 8;
  }
  string name = 1; fixed32 offset = 2; PackedElementField.NumericType type = 3;
}
message PointCloud {
  Timestamp timestamp = 1; string frame_id = 2; Pose pose = 3; fixed32 point_stride = 4;
  repeated PackedElementField fields = 5; bytes data = 6;
}
message RawImage {
  Timestamp timestamp = 1; string frame_id = 7; fixed32 width = 2; fixed32 height = 3; string encoding = 4;
  fixed32 step = 5; bytes data = 6;
}
message CameraCalibration {
  Timestamp timestamp = 1; string frame_id = 9; fixed32 width = 2; fixed32 height = 3;
  string distortion_model = 4; repeated double D = 5; repeated double K = 6; repeated double R = 7;
  repeated double P = 8;
}
message PoseInFrame { Timestamp timestamp = 1; string frame_id = 2; Pose pose = 3; }
message Odometry {
  Timestamp timestamp = 1; string frame_id = 2; string body_frame_id = 3; Pose pose = 4;
  repeated double pose_covariance = 7;
}
message JointState {
  string name = 1; optional double position = 2; optional double velocity = 3; optional double effort = 5;
}
message JointStates { Timestamp timestamp = 1; repeated JointState joints = 2; }
message FrameTransform {
  Timestamp timestamp = 1; string parent_frame_id = 2; string child_frame_id = 3; Vector3 translation = 4;
  Quaternion rotation = 5;
}
message FrameTransforms { repeated FrameTransform transforms = 1; }
message LocationFix {
  enum PositionCovarianceType { UNKNOWN = 0; APPROXIMATED = 1; DIAGONAL_KNOWN = 2; KNOWN = 3; }
  Timestamp timestamp = 6; string frame_id = 7; double latitude = 1; double longitude = 2;
  double altitude = 3; repeated double position_covariance = 4;
  LocationFix.PositionCovarianceType position_covariance_type = 5;
}
"""
_MESSAGE = re.compile(r"message (\w+) \{((?:[^{}]|\{[^{}]*\})*)\}")
_ENUM = re.compile(r"enum (\w+) \{([^{}]*)\}")
_VALUE = re.compile(r"(\w+) = (\d+);")
_FIELD = re.compile(r"(repeated |optional )?([\w.]+) (\w+) = (\d+);")
_SCALARS = {
    "double": FieldDescriptorProto.TYPE_DOUBLE,
    "string": FieldDescriptorProto.TYPE_STRING,
    "bytes": FieldDescriptorProto.TYPE_BYTES,
    "fixed32": FieldDescriptorProto.TYPE_FIXED32,
}
#: Wire type of bytes, strings and messages in protobuf.
_LENGTH_DELIMITED = 2
_COUNT = {"type": "integer", "minimum": 0}
_JSON_SCALARS: dict[int, dict[str, Any]] = {
    FieldDescriptorProto.TYPE_DOUBLE: {"type": "number"},
    FieldDescriptorProto.TYPE_STRING: {"type": "string"},
    FieldDescriptorProto.TYPE_BYTES: {"type": "string", "contentEncoding": "base64"},
    FieldDescriptorProto.TYPE_FIXED32: _COUNT,
}
_JSON_TIME = {
    "type": "object",
    "title": "time",
    "properties": {"sec": _COUNT, "nsec": {**_COUNT, "maximum": 999_999_999}},
}


@cache
def schema_bytes() -> bytes:
    """Return the definitions of all messages as a serialised ``FileDescriptorSet``."""
    return bytes(FileDescriptorSet(file=_files()).SerializeToString())


def message_bytes(name: str, fields: Mapping[str, Any]) -> bytes:
    """Return a message in protobuf.

    Parameters
    ----------
    name : str
        Name of the message, such as ``PointCloud``.
    fields : mapping
        Values by name. Arrays of bytes are appended to the other fields, since a message class would copy
        them several times.
    """
    message = message_class(name)
    large = {key: value for key, value in fields.items() if _is_bytes(value)}
    parts: list[Any] = [message(**{k: v for k, v in fields.items() if k not in large}).SerializeToString()]
    for key, value in large.items():
        number = message.DESCRIPTOR.fields_by_name[key].number
        data = np.ascontiguousarray(value)
        parts += [_varint(number << 3 | _LENGTH_DELIMITED), _varint(data.size), data.data]
    return b"".join(parts)


def _is_bytes(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == np.uint8


def _varint(number: int) -> bytes:
    """Return a number in groups of seven bits, the lowest first."""
    groups = bytearray()
    while number > 0x7F:
        groups.append(number & 0x7F | 0x80)
        number >>= 7
    groups.append(number)
    return bytes(groups)


def json_schema(name: str) -> dict[str, Any]:
    """Return the JSON schema of a message."""
    return _json_schema(message_class(name).DESCRIPTOR)


def _json_schema(descriptor: Any) -> dict[str, Any]:
    proto = DescriptorProto()
    descriptor.CopyToProto(proto)
    properties = {}
    for field in proto.field:
        item = _json_item(descriptor.fields_by_name[field.name])
        is_repeated = field.label == FieldDescriptorProto.LABEL_REPEATED
        properties[field.name] = {"type": "array", "items": item} if is_repeated else item
    required = [field.name for field in proto.field if not field.proto3_optional]
    title = f"{PACKAGE}.{descriptor.name}"
    return {"title": title, "type": "object", "properties": properties, "required": required}


def _json_item(field: Any) -> dict[str, Any]:
    """Return the JSON schema of a field, or of the elements of a repeated one."""
    if field.enum_type is not None:
        values = [{"title": value.name, "const": value.number} for value in field.enum_type.values]
        return {"title": f"{PACKAGE}.{field.enum_type.name}", "oneOf": values}
    if field.message_type is None:
        return _JSON_SCALARS[field.type]
    is_time = field.message_type.full_name == "google.protobuf.Timestamp"
    return _JSON_TIME if is_time else _json_schema(field.message_type)


@cache
def message_class(name: str) -> Any:
    """Return the class of a message, such as ``PointCloud``."""
    return GetMessageClass(_pool().FindMessageTypeByName(f"{PACKAGE}.{name}"))


@cache
def _pool() -> Any:
    pool = DescriptorPool()
    for file in _files():
        pool.Add(file)
    return pool


def _files() -> list[Any]:
    time = FileDescriptorProto()
    timestamp_pb2.DESCRIPTOR.CopyToProto(time)
    messages = [_message(*match.groups()) for match in _MESSAGE.finditer(_SCHEMAS)]
    foxglove_file = FileDescriptorProto(
        name="foxglove.proto",
        package=PACKAGE,
        syntax="proto3",
        dependency=[time.name],
        message_type=messages,
    )
    return [time, foxglove_file]


def _message(name: str, body: str) -> Any:
    message = DescriptorProto(name=name)
    for enum, values in _ENUM.findall(body):
        added = message.enum_type.add(name=enum)
        for value, number in _VALUE.findall(values):
            added.value.add(name=value, number=int(number))
    for label, kind, field_name, number in _FIELD.findall(_ENUM.sub("", body)):
        is_repeated, is_optional = label == "repeated ", label == "optional "
        field = message.field.add(
            name=field_name,
            number=int(number),
            label=FieldDescriptorProto.LABEL_REPEATED if is_repeated else FieldDescriptorProto.LABEL_OPTIONAL,
            proto3_optional=is_optional,
        )
        if is_optional:  # proto3 represents it as a choice of one
            field.oneof_index = len(message.oneof_decl)
            message.oneof_decl.add(name=f"_{field_name}")
        if kind in _SCALARS:
            field.type = _SCALARS[kind]
            continue
        field.type = FieldDescriptorProto.TYPE_ENUM if "." in kind else FieldDescriptorProto.TYPE_MESSAGE
        field.type_name = ".google.protobuf.Timestamp" if kind == "Timestamp" else f".{PACKAGE}.{kind}"
    return message

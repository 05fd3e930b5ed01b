# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS as messages of Foxglove's schemas in protobuf or JSON, the inverse of ``foxglove``.

Types that Foxglove lacks, such as those of an IMU, stay messages of ROS 2: an MCAP file can hold both.
"""

from __future__ import annotations

import binascii
import json
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import numpy as np

from cdff_dev.logs.formats.ros.foxglove_protobuf import PACKAGE, json_schema, message_bytes, schema_bytes
from services.ros_messages.message_types import RosTypes

#: Fields of a message by name; times as in protobuf, bytes and lists of numbers as arrays.
Fields = Mapping[str, Any]
#: Numeric type of Foxglove by that of ``sensor_msgs/PointField``.
_NUMERIC_TYPES = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}
_ORIGIN = {
    "position": {"x": 0.0, "y": 0.0, "z": 0.0},
    "orientation": {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0},
}


def _time(header: Any) -> dict[str, int]:
    return {"seconds": header.stamp.sec, "nanos": header.stamp.nanosec}


def _stamped(header: Any, **fields: Any) -> Fields:
    return {"timestamp": _time(header), "frame_id": header.frame_id, **fields}


def _xyz(value: Any) -> dict[str, float]:
    return {"x": value.x, "y": value.y, "z": value.z}


def _pose(pose: Any) -> dict[str, Any]:
    return {"position": _xyz(pose.position), "orientation": _quaternion(pose.orientation)}


def _quaternion(value: Any) -> dict[str, float]:
    return {**_xyz(value), "w": value.w}


def _cloud(message: Any) -> Fields:
    return _stamped(
        message.header,
        pose=_ORIGIN,
        point_stride=message.point_step,
        fields=[
            {"name": f.name, "offset": f.offset, "type": _NUMERIC_TYPES[f.datatype]} for f in message.fields
        ],
        data=message.data,
    )


def _image(message: Any) -> Fields:
    names = ("width", "height", "encoding", "step", "data")
    return _stamped(message.header, **{name: getattr(message, name) for name in names})


def _camera(message: Any) -> Fields:
    return _stamped(
        message.header,
        width=message.width,
        height=message.height,
        distortion_model=message.distortion_model,
        **{name.upper(): getattr(message, name) for name in "dkrp"},
    )


def _pose_in_frame(message: Any) -> Fields:
    return _stamped(message.header, pose=_pose(message.pose))


def _odometry(message: Any) -> Fields:
    return _stamped(
        message.header,
        body_frame_id=message.child_frame_id,
        pose=_pose(message.pose.pose),
        pose_covariance=message.pose.covariance,
    )


def _joints(message: Any) -> Fields:
    """Return joints; unknown values are absent, since JSON has no NaN."""
    names = ("position", "velocity", "effort")
    rows = zip(message.name, message.position, message.velocity, message.effort, strict=True)
    joints = [
        {"name": name, **{key: float(x) for key, x in zip(names, row, strict=True) if not np.isnan(x)}}
        for name, *row in rows
    ]
    return {"timestamp": _time(message.header), "joints": joints}


def _fix(message: Any) -> Fields:
    names = ("latitude", "longitude", "altitude", "position_covariance", "position_covariance_type")
    return _stamped(message.header, **{name: getattr(message, name) for name in names})


def _transforms(message: Any) -> Fields:
    transforms = [
        {
            "timestamp": _time(part.header),
            "parent_frame_id": part.header.frame_id,
            "child_frame_id": part.child_frame_id,
            "translation": _xyz(part.transform.translation),
            "rotation": _quaternion(part.transform.rotation),
        }
        for part in message.transforms
    ]
    return {"transforms": transforms}


#: Foxglove schema by the name of a ROS type, and the function that converts a message to its fields.
SCHEMAS: dict[str, tuple[str, Callable[[Any], Fields]]] = {
    "sensor_msgs/msg/PointCloud2": ("PointCloud", _cloud),
    "sensor_msgs/msg/Image": ("RawImage", _image),
    "sensor_msgs/msg/CameraInfo": ("CameraCalibration", _camera),
    "geometry_msgs/msg/PoseStamped": ("PoseInFrame", _pose_in_frame),
    "nav_msgs/msg/Odometry": ("Odometry", _odometry),
    "sensor_msgs/msg/JointState": ("JointStates", _joints),
    "sensor_msgs/msg/NavSatFix": ("LocationFix", _fix),
    "tf2_msgs/msg/TFMessage": ("FrameTransforms", _transforms),
}


class FoxgloveTypes(RosTypes):
    """Types of ROS 2; messages for which Foxglove has a schema are serialised in it.

    Parameters
    ----------
    encoding : str
        ``protobuf`` or ``json``.
    """

    without_frame = frozenset({"sensor_msgs/msg/JointState"})
    _SCHEMA_ENCODINGS: ClassVar = {"protobuf": "protobuf", "json": "jsonschema"}

    def __init__(self, encoding: str) -> None:
        super().__init__(2)
        self.encoding = encoding

    def schema(self, type_name: str) -> tuple[str, str, bytes] | None:
        """Return name, encoding and definition of the schema of a type; None if Foxglove has none."""
        if type_name not in SCHEMAS:
            return None
        name = SCHEMAS[type_name][0]
        data = schema_bytes() if self.encoding == "protobuf" else json.dumps(json_schema(name)).encode()
        return f"{PACKAGE}.{name}", self._SCHEMA_ENCODINGS[self.encoding], data

    def remark(self, type_name: str) -> str:
        """Return why few programs read messages of a type; empty if that is not so."""
        is_known = type_name in SCHEMAS or super().remark(type_name)
        return super().remark(type_name) if is_known else "Foxglove has no schema for it"

    def serialize(self, message: Any, type_name: str) -> memoryview | bytes:
        """Return the bytes of a message."""
        if type_name not in SCHEMAS:
            return super().serialize(message, type_name)
        name, fields_of = SCHEMAS[type_name]
        fields = fields_of(message)
        if self.encoding == "protobuf":
            return message_bytes(name, fields)
        return _json_bytes(fields)


def _json_bytes(fields: Fields) -> bytes:
    """Return a message in JSON; bytes are appended, since a JSON encoder would copy them several times."""
    large = {name: value for name, value in fields.items() if _is_bytes(value)}
    others = {name: _json_value(value) for name, value in fields.items() if name not in large}
    parts = [json.dumps(others, allow_nan=False, separators=(",", ":")).encode()[:-1]]
    for name, value in large.items():
        parts += [f',"{name}":"'.encode(), binascii.b2a_base64(value, newline=False), b'"']
    return b"".join((*parts, b"}"))


def _is_bytes(value: Any) -> bool:
    return isinstance(value, np.ndarray) and value.dtype == np.uint8


def _json_value(value: Any) -> Any:
    """Return a value as JSON has it: times as ``sec`` and ``nsec``."""
    if isinstance(value, Mapping):
        if value.keys() == {"seconds", "nanos"}:
            return {"sec": int(value["seconds"]), "nsec": int(value["nanos"])}
        return {name: _json_value(item) for name, item in value.items()}
    if isinstance(value, list):
        return [_json_value(item) for item in value]
    if isinstance(value, np.ndarray):
        return value.tolist()
    return value

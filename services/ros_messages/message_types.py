# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS 1 and ROS 2 made from values by name, for writers of logs and gateways."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

BITSTREAM = "infuse_msgs/msg/Asn1Bitstream"
#: Definitions of types that the type stores lack: those of the InFuse robots, frame trees and grid maps.
_DEFINITIONS = {
    BITSTREAM: "std_msgs/Header header\nstring type\nuint8 serialization_method\nuint8[] data\n",
    "tf2_msgs/msg/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
    "grid_map_msgs/msg/GridMapInfo": """{header}float64 resolution
float64 length_x
float64 length_y
geometry_msgs/Pose pose
""",
    "grid_map_msgs/msg/GridMap": """{header_2}GridMapInfo info
string[] layers
string[] basic_layers
std_msgs/Float32MultiArray[] data
uint16 outer_start_index
uint16 inner_start_index
""",
}
#: Definitions of types of ROS 2 only: detections, version 4 of their package.
_DEFINITIONS_2 = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nObjectHypothesisWithPose[] results\nBoundingBox3D bbox\nstring id\n"
    ),
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nDetection3D[] detections\n",
}
_HEADER = "std_msgs/Header header\n"
_NS_PER_S = 1_000_000_000


class RosTypes:
    """Types of one version of ROS.

    Parameters
    ----------
    version : int
        1 (noetic) or 2 (jazzy).

    Attributes
    ----------
    without_frame : frozenset of str
        Message types whose encoding has no frame in the header.
    """

    without_frame: frozenset[str] = frozenset()

    def __init__(self, version: int) -> None:
        self.version = version
        self.store = get_typestore(Stores.ROS1_NOETIC if version == 1 else Stores.ROS2_JAZZY)
        headers = {"header": _HEADER if version == 1 else "", "header_2": "" if version == 1 else _HEADER}
        definitions = _DEFINITIONS | (_DEFINITIONS_2 if version == 2 else {})
        for name, definition in definitions.items():
            if name not in self.store.types:
                self.store.register(get_types_from_msg(definition.format(**headers), name))

    def make(self, name: str, /, **fields: Any) -> Any:
        """Return a message of ``package/Type``; fields of CameraInfo are in lower case as in ROS 2."""
        if name == "sensor_msgs/CameraInfo" and self.version == 1:
            fields = {k.upper() if len(k) == 1 else k: v for k, v in fields.items()}
        package, _, kind = name.partition("/")
        return self.store.types[f"{package}/msg/{kind}"](**fields)

    def header(self, stamp_ns: int, frame_id: str) -> Any:
        """Return a header."""
        time = self.make("builtin_interfaces/Time", sec=stamp_ns // _NS_PER_S, nanosec=stamp_ns % _NS_PER_S)
        sequence = {"seq": 0} if self.version == 1 else {}
        return self.make("std_msgs/Header", stamp=time, frame_id=frame_id, **sequence)

    def vector(self, xyz: NDArray[np.float64], name: str = "Vector3") -> Any:
        """Return a vector, or a point."""
        x, y, z = (float(v) for v in xyz)
        return self.make(f"geometry_msgs/{name}", x=x, y=y, z=z)

    def quaternion(self, xyzw: NDArray[np.float64]) -> Any:
        """Return a quaternion."""
        x, y, z, w = (float(v) for v in xyzw)
        return self.make("geometry_msgs/Quaternion", x=x, y=y, z=z, w=w)

    def remark(self, type_name: str) -> str:
        """Return why few programs read messages of a type; empty if that is not so."""
        return "only CDFF and robots of InFuse read it" if type_name == BITSTREAM else ""

    def serialize(self, message: Any, type_name: str) -> memoryview | bytes:
        """Return the bytes of a message."""
        if self.version == 1:
            return self.store.serialize_ros1(message, type_name)
        return self.store.serialize_cdr(message, type_name)

    def deserialize(self, data: bytes, type_name: str) -> Any:
        """Return the message in bytes; raises errors of rosbags and of Python on others."""
        if self.version == 1:
            return self.store.deserialize_ros1(data, type_name)
        return self.store.deserialize_cdr(memoryview(data), type_name)  # whose slices are no copies

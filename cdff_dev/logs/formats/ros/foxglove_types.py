# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS as messages of Foxglove's schemas in protobuf, the inverse of ``foxglove``.

Types that Foxglove lacks, such as those of an IMU, stay messages of ROS 2: an MCAP file can hold both.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from cdff_dev.logs.formats.ros.foxglove_protobuf import message_class
from services.ros_messages.message_types import RosTypes

#: Numeric type of Foxglove by that of ``sensor_msgs/PointField``.
_NUMERIC_TYPES = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}


def _make(name: str, header: Any, **fields: Any) -> Any:
    message = message_class(name)(**fields)
    message.timestamp.seconds, message.timestamp.nanos = header.stamp.sec, header.stamp.nanosec
    return message


def _xyz(value: Any) -> dict[str, float]:
    return {"x": value.x, "y": value.y, "z": value.z}


def _pose(pose: Any) -> dict[str, Any]:
    return {"position": _xyz(pose.position), "orientation": _quaternion(pose.orientation)}


def _quaternion(value: Any) -> dict[str, float]:
    return {**_xyz(value), "w": value.w}


def _cloud(message: Any) -> Any:
    fields = [
        {"name": f.name, "offset": f.offset, "type": _NUMERIC_TYPES[f.datatype]} for f in message.fields
    ]
    return _make(
        "PointCloud",
        message.header,
        frame_id=message.header.frame_id,
        pose={"position": {}, "orientation": {"w": 1.0}},
        point_stride=message.point_step,
        fields=fields,
        data=message.data.tobytes(),
    )


def _image(message: Any) -> Any:
    return _make(
        "RawImage",
        message.header,
        frame_id=message.header.frame_id,
        width=message.width,
        height=message.height,
        encoding=message.encoding,
        step=message.step,
        data=message.data.tobytes(),
    )


def _camera(message: Any) -> Any:
    return _make(
        "CameraCalibration",
        message.header,
        frame_id=message.header.frame_id,
        width=message.width,
        height=message.height,
        distortion_model=message.distortion_model,
        **{name.upper(): getattr(message, name) for name in "dkrp"},
    )


def _pose_in_frame(message: Any) -> Any:
    return _make("PoseInFrame", message.header, frame_id=message.header.frame_id, pose=_pose(message.pose))


def _odometry(message: Any) -> Any:
    return _make(
        "Odometry",
        message.header,
        frame_id=message.header.frame_id,
        body_frame_id=message.child_frame_id,
        pose=_pose(message.pose.pose),
        pose_covariance=message.pose.covariance,
    )


def _joints(message: Any) -> Any:
    rows = zip(message.name, message.position, message.velocity, message.effort, strict=True)
    names = ("name", "position", "velocity", "effort")
    return _make("JointStates", message.header, joints=[dict(zip(names, row, strict=True)) for row in rows])


def _fix(message: Any) -> Any:
    return _make(
        "LocationFix",
        message.header,
        frame_id=message.header.frame_id,
        latitude=message.latitude,
        longitude=message.longitude,
        altitude=message.altitude,
        position_covariance=message.position_covariance,
        position_covariance_type=message.position_covariance_type,
    )


def _transform(message: Any) -> Any:
    return _make(
        "FrameTransform",
        message.header,
        parent_frame_id=message.header.frame_id,
        child_frame_id=message.child_frame_id,
        translation=_xyz(message.transform.translation),
        rotation=_quaternion(message.transform.rotation),
    )


def _transforms(message: Any) -> Any:
    return message_class("FrameTransforms")(transforms=[_transform(part) for part in message.transforms])


#: Schema of Foxglove, and conversion to it, by the type of ROS.
SCHEMAS: dict[str, tuple[str, Callable[[Any], Any]]] = {
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
    """Types of ROS 2 whose messages are serialised as those of Foxglove where it has a schema."""

    without_frame = frozenset({"sensor_msgs/msg/JointState"})

    def __init__(self) -> None:
        super().__init__(2)

    def serialize(self, message: Any, type_name: str) -> memoryview | bytes:
        """Return the bytes of a message."""
        if type_name not in SCHEMAS:
            return super().serialize(message, type_name)
        return bytes(SCHEMAS[type_name][1](message).SerializeToString())

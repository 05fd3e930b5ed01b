# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ROS messages to CDFF types, by message type.

Covariances need no conversion: order and side are those of ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.contract.foreign_names import ANCHOR_PORT, FIX_PORT
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import Asn1Bitstream, IMUSensors, Joints, JointState, Time, TransformWithCovariance
from services.ros_messages.clouds import laser_scan, lidar_scan
from services.ros_messages.depth import depth_image
from services.ros_messages.fixes import FIX, local_frame_pose, position
from services.ros_messages.images import frame
from services.ros_messages.maps import GRID_MAP, OCCUPANCY_GRID, elevation_map, navigation_map
from services.ros_messages.topics import Topic

#: Value, frame and child frame of a sample.
Converted = tuple[Any, str, str | None]


@dataclass(frozen=True, slots=True)
class Conversion:
    """Conversion of a message type.

    Attributes
    ----------
    type_name : str
        ASN.1 type of the samples.
    port : str
        Last part of the names of its streams.
    convert : callable
        From message, topic and stamp.
    has_header : bool
        Whether the message begins with ``std_msgs/Header``.
    split : callable, optional
        Returns the messages with a header of which a message is made, each a sample of a stream of its own.
    """

    type_name: str
    port: str
    convert: Callable[[Any, Topic, int], Converted]
    has_header: bool = True
    split: Callable[[Any], Sequence[Any]] | None = None


def _vector(v: Any) -> FloatArray:
    return np.array([v.x, v.y, v.z], dtype=np.float64)


def _imu(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return angular velocity and acceleration; CDFF has no orientation in an IMU sample."""
    acc, gyro = _vector(message.linear_acceleration), _vector(message.angular_velocity)
    return (
        IMUSensors(Time.from_ns(stamp_ns), acc, gyro, np.zeros(3)),
        topic.frame(message.header.frame_id),
        None,
    )


def _transform(
    topic: Topic, stamp_ns: int, parent: str, child: str, parts: tuple[Any, Any], covariance: Any = None
) -> Converted:
    """Return a transform; a covariance of zeros is unknown, as ROS defines."""
    position, q = parts
    T = se3.transform_from_quaternion_xyzw(_vector(position), np.array([q.x, q.y, q.z, q.w]))
    cov = None if covariance is None else np.asarray(covariance, np.float64).reshape(6, 6)
    known = cov if cov is not None and np.any(cov) else None
    names = topic.frame(parent), topic.frame(child)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(T, known), parent=names[0], child=names[1], stamp_ns=stamp_ns, producer=topic.robot
    )
    return value, *names


def _odometry(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    pose = message.pose.pose
    parts = (pose.position, pose.orientation)
    parent, child = message.header.frame_id, message.child_frame_id or "base_link"
    return _transform(topic, stamp_ns, parent, child, parts, message.pose.covariance)


def _pose(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    parts = (message.pose.position, message.pose.orientation)
    return _transform(topic, stamp_ns, message.header.frame_id, "base_link", parts)


def _pose_with_covariance(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    pose = message.pose.pose
    parts = (pose.position, pose.orientation)
    return _transform(topic, stamp_ns, message.header.frame_id, "base_link", parts, message.pose.covariance)


def _transform_stamped(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    parts = (message.transform.translation, message.transform.rotation)
    return _transform(topic, stamp_ns, message.header.frame_id, message.child_frame_id, parts)


def _joints(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return positions, velocities and efforts of joints; NaN where a message has none."""

    def column(values: Any) -> FloatArray:
        return np.asarray(values, np.float64) if len(values) else np.full(len(message.name), np.nan)

    rows = zip(column(message.position), column(message.velocity), column(message.effort), strict=True)
    states = tuple(JointState(float(p), float(v), float(e), np.nan, np.nan) for p, v, e in rows)
    value = Joints(Time.from_ns(stamp_ns), tuple(message.name), states)
    return value, topic.frame(message.header.frame_id), None


def _bitstream(message: Any, topic: Topic, _: int) -> Converted:
    """Return an encoded message of the InFuse robots."""
    data = np.asarray(message.data, np.uint8)
    value = Asn1Bitstream(message.type, int(message.serialization_method), data)
    return value, topic.frame(message.header.frame_id), None


def _transforms(message: Any) -> Sequence[Any]:
    return tuple(message.transforms)


def transform_matrix(transform: Any) -> FloatArray:
    """Return the pose ``(4, 4)`` of a ``TransformStamped``: of its child frame in the frame of its header."""
    q = transform.transform.rotation
    return se3.transform_from_quaternion_xyzw(
        _vector(transform.transform.translation), np.array([q.x, q.y, q.z, q.w])
    )


_FRAME_TREE = Conversion(
    "TransformWithCovariance", "pose", _transform_stamped, has_header=False, split=_transforms
)
#: Pose of the local frame of positions, a second stream of their topic.
LOCAL_FRAME_POSE = Conversion("TransformWithCovariance", ANCHOR_PORT, local_frame_pose)
#: Message types of frame trees.
FRAME_TREES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
#: Message type of calibrations, which become part of the images.
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
#: Message types of images.
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
#: Message type of clouds, whose fields differ.
CLOUD = "sensor_msgs/msg/PointCloud2"
CONVERSIONS = {
    "sensor_msgs/msg/Imu": Conversion("IMUSensors", "imu", _imu),
    "nav_msgs/msg/Odometry": Conversion("TransformWithCovariance", "pose", _odometry),
    "geometry_msgs/msg/PoseStamped": Conversion("TransformWithCovariance", "pose", _pose),
    "geometry_msgs/msg/PoseWithCovarianceStamped": Conversion(
        "TransformWithCovariance", "pose", _pose_with_covariance
    ),
    "geometry_msgs/msg/TransformStamped": Conversion("TransformWithCovariance", "pose", _transform_stamped),
    **dict.fromkeys(FRAME_TREES, _FRAME_TREE),
    "sensor_msgs/msg/JointState": Conversion("Joints", "joints", _joints),
    FIX: Conversion("TransformWithCovariance", FIX_PORT, position),
    "infuse_msgs/msg/Asn1Bitstream": Conversion("Asn1Bitstream", "bitstream", _bitstream),
    CLOUD: Conversion("LidarScan", "scan", lidar_scan),
    "sensor_msgs/msg/LaserScan": Conversion("LidarScan", "scan", laser_scan),
    **dict.fromkeys(IMAGES, Conversion("Frame", "frame", frame)),
    OCCUPANCY_GRID: Conversion("NavigationMap", "map", navigation_map),
    GRID_MAP: Conversion("ElevationMap", "map", elevation_map),
}
#: Conversion of topics of depth images.
DEPTH = Conversion("DistanceImage", "depth", depth_image)
#: Fields of the other message types that no CDFF field has.
OMITTED_FIELDS = {
    "sensor_msgs/msg/Imu": ("orientation", "covariances"),
    "nav_msgs/msg/Odometry": ("twist",),
    FIX: ("status", "position_covariance_type"),
}
#: Reasons why message types with a known content have no stream.
NO_CONVERSION = {
    "nav_msgs/msg/Path": "no CDFF type has poses without times",
}

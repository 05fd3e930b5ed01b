# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ROS messages to CDFF types, by message type as in the table ``mapping.yaml``.

Covariances need no conversion: order and side are those of ROS.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cdff_common.contract.foreign_names import ANCHOR_PORT
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import Asn1Bitstream, IMUSensors, Joints, JointState, Time, TransformWithCovariance
from services.ros_messages.fixes import local_frame_pose
from services.ros_messages.mapping import MessageMapping, function, mapping_table
from services.ros_messages.topics import Topic

#: Value, frame and child frame of a sample.
Converted = tuple[Any, str, str | None]
_NS_PER_S = 1_000_000_000


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


def imu(message: Any, topic: Topic, stamp_ns: int) -> Converted:
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


def odometry(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return the pose of an odometry message, whose child frame is the base without one."""
    pose = message.pose.pose
    parts = (pose.position, pose.orientation)
    parent, child = message.header.frame_id, message.child_frame_id or "base_link"
    return _transform(topic, stamp_ns, parent, child, parts, message.pose.covariance)


def pose(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return the pose of the base."""
    parts = (message.pose.position, message.pose.orientation)
    return _transform(topic, stamp_ns, message.header.frame_id, "base_link", parts)


def pose_with_covariance(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return the pose of the base with its covariance."""
    pose = message.pose.pose
    parts = (pose.position, pose.orientation)
    return _transform(topic, stamp_ns, message.header.frame_id, "base_link", parts, message.pose.covariance)


def transform_stamped(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return a transform of a frame tree."""
    parts = (message.transform.translation, message.transform.rotation)
    return _transform(topic, stamp_ns, message.header.frame_id, message.child_frame_id, parts)


def joints(message: Any, topic: Topic, stamp_ns: int) -> Converted:
    """Return positions, velocities and efforts of joints; NaN where a message has none."""

    def column(values: Any) -> FloatArray:
        return np.asarray(values, np.float64) if len(values) else np.full(len(message.name), np.nan)

    rows = zip(column(message.position), column(message.velocity), column(message.effort), strict=True)
    states = tuple(JointState(float(p), float(v), float(e), np.nan, np.nan) for p, v, e in rows)
    value = Joints(Time.from_ns(stamp_ns), tuple(message.name), states)
    return value, topic.frame(message.header.frame_id), None


def bitstream(message: Any, topic: Topic, _: int) -> Converted:
    """Return an encoded message of the InFuse robots."""
    data = np.asarray(message.data, np.uint8)
    value = Asn1Bitstream(message.type, int(message.serialization_method), data)
    return value, topic.frame(message.header.frame_id), None


def transforms(message: Any) -> Sequence[Any]:
    """Return the transforms of a frame tree."""
    return tuple(message.transforms)


def transform_matrix(transform: Any) -> FloatArray:
    """Return the pose ``(4, 4)`` of a ``TransformStamped``: of its child frame in the frame of its header."""
    q = transform.transform.rotation
    return se3.transform_from_quaternion_xyzw(
        _vector(transform.transform.translation), np.array([q.x, q.y, q.z, q.w])
    )


def clock(message: Any, _: Topic, __: int) -> Converted:
    """Return a simulated time."""
    time = message.clock
    return Time.from_ns((time.sec * _NS_PER_S + time.nanosec) // 1000 * 1000), "", None


def _conversion(entry: MessageMapping) -> Conversion:
    """Return the conversion of an entry of the table."""
    assert entry.read is not None
    split = None if entry.split is None else function(entry.split)
    return Conversion(entry.type, entry.port, function(entry.read), has_header=entry.has_header, split=split)


#: Conversions by message type.
CONVERSIONS = {message: _conversion(entry) for message, entry in mapping_table().readers().items()}
#: Reasons why log readers leave out message types with a conversion.
NOT_LOGGED = {message: entry.logs for message, entry in mapping_table().readers().items() if entry.logs}
#: Fields of the message types that no CDFF field has.
OMITTED_FIELDS = {
    message: entry.not_read for message, entry in mapping_table().readers().items() if entry.not_read
}
#: Conversion of topics of depth images.
DEPTH = next(
    _conversion(entry)
    for entry in mapping_table().messages
    if entry.type == "DistanceImage" and entry.read is not None
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

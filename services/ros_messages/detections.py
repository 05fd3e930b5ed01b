# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Detections of objects of ROS 2: ``vision_msgs/Detection3DArray``."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import ObjectDetection, ObjectDetections, Time, TransformWithCovariance
from services.ros_messages.topics import Topic


def detections(message: Any, topic: Topic, stamp_ns: int) -> tuple[ObjectDetections, str, None]:
    """Return the first hypothesis of each detection, with its pose in the frame of the header.

    Raises
    ------
    InputError
        If a detection has no hypothesis, or another frame than the message.
    """
    name = topic.frame(message.header.frame_id)
    items = tuple(_detection(item, message.header.frame_id, topic, stamp_ns) for item in message.detections)
    value = ObjectDetections(
        time_stamp=Time.from_ns(stamp_ns), producer_id=topic.robot, frame_id=name, detections=items
    )
    return value, name, None


def _detection(item: Any, frame_id: str, topic: Topic, stamp_ns: int) -> ObjectDetection:
    if item.header.frame_id not in ("", frame_id):
        raise InputError(f"{topic.name}: detection in {item.header.frame_id!r}, expected {frame_id!r}")
    if not item.results:
        raise InputError(f"{topic.name}: detection without a hypothesis, expected a class and a score")
    first = item.results[0]
    position, q = first.pose.pose.position, first.pose.pose.orientation
    T = se3.transform_from_quaternion_xyzw(
        np.array([position.x, position.y, position.z]), np.array([q.x, q.y, q.z, q.w])
    )
    covariance = np.asarray(first.pose.covariance, np.float64).reshape(6, 6)
    label, size = first.hypothesis.class_id, item.bbox.size
    pose = TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance if covariance.any() else None),
        parent=topic.frame(frame_id),
        child=topic.frame(label),
        stamp_ns=stamp_ns,
        producer=topic.robot,
    )
    return ObjectDetection.from_pose(
        label, float(first.hypothesis.score), pose, size_m=(size.x, size.y, size.z)
    )

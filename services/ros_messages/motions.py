# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Velocities and paths of ROS: ``geometry_msgs/TwistStamped`` and ``nav_msgs/Path``."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import PoseTrajectory, Time, TwistWithCovariance
from cdff_common.types.pose import TwistWithCovarianceData, TwistWithCovarianceMetadata
from services.ros_messages.topics import Topic

_NS_PER_S = 1_000_000_000


def twist(message: Any, topic: Topic, stamp_ns: int) -> tuple[TwistWithCovariance, str, None]:
    """Return linear (m/s) and angular (rad/s) velocity in the frame of the header, without a covariance."""
    return _twist(message, topic, stamp_ns, message.twist, None)


def twist_with_covariance(message: Any, topic: Topic, stamp_ns: int) -> tuple[TwistWithCovariance, str, None]:
    """Return linear and angular velocity with their covariance; zeros are an unknown covariance."""
    return _twist(message, topic, stamp_ns, message.twist.twist, message.twist.covariance)


def _twist(
    message: Any, topic: Topic, stamp_ns: int, velocity: Any, covariance: Any
) -> tuple[TwistWithCovariance, str, None]:
    linear, angular = (np.array([v.x, v.y, v.z]) for v in (velocity.linear, velocity.angular))
    if not np.isfinite([*linear, *angular]).all():
        raise InputError(f"{topic.name}: velocity {linear} m/s, {angular} rad/s: expected finite numbers")
    known = np.zeros(36) if covariance is None else np.asarray(covariance, np.float64)
    cov = known.reshape(6, 6) if known.any() else np.full((6, 6), np.nan)
    metadata = TwistWithCovarianceMetadata(time_stamp=Time.from_ns(stamp_ns))
    data = TwistWithCovarianceData(linear, angular, cov)
    return TwistWithCovariance(metadata, data), topic.frame(message.header.frame_id), None


def path(message: Any, topic: Topic, _: int) -> tuple[PoseTrajectory, str, str]:
    """Return the poses of the base along a path with a time for each.

    Raises
    ------
    InputError
        If the times do not ascend, or a pose has another frame than the path.
    """
    frames = {pose.header.frame_id for pose in message.poses} - {"", message.header.frame_id}
    if frames:
        raise InputError(
            f"{topic.name}: poses in {sorted(frames)[0]!r}, expected {message.header.frame_id!r}"
        )
    stamps = [p.header.stamp for p in message.poses]
    stamps_ns = np.array([(s.sec * _NS_PER_S + s.nanosec) // 1000 * 1000 for s in stamps], np.int64)
    if (np.diff(stamps_ns) <= 0).any():
        raise InputError(
            f"{topic.name}: the times of the {len(stamps)} poses do not ascend; expected a trajectory"
        )
    parts = [(p.pose.position, p.pose.orientation) for p in message.poses]
    matrices = [
        se3.transform_from_quaternion_xyzw(np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w]))
        for p, q in parts
    ]
    parent, child = topic.frame(message.header.frame_id), topic.frame("base_link")
    value = PoseTrajectory.from_arrays(
        stamps_ns,
        np.array(matrices).reshape(-1, 4, 4),
        parent=parent,
        child=child,
        producer=topic.robot,
    )
    return value, parent, child

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS for the types of CDFF that are not images."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.codecs.bitstream import wrap
from cdff_common.errors import InputError
from cdff_common.types import IMUSensors, Joints, LidarScan, TransformWithCovariance
from services.ros_messages.encoding import Encoded, Encoder, Target, single
from services.ros_messages.fixes import FIX, fix_fields
from services.ros_messages.mapping import function, mapping_table
from services.ros_messages.message_types import BITSTREAM, RosTypes

#: Type of encoded values, which are sent as they are.
BITSTREAM_TYPE = "Asn1Bitstream"


def imu(value: IMUSensors, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``sensor_msgs/Imu`` without orientation, as its first covariance of -1 states."""
    message = types.make(
        "sensor_msgs/Imu",
        header=types.header(stamp_ns, target.new_frame(target.frame)),
        orientation=types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
        orientation_covariance=np.array([-1.0, *np.zeros(8)]),
        angular_velocity=types.vector(value.gyro),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=types.vector(value.acc),
        linear_acceleration_covariance=np.zeros(9),
    )
    return single("sensor_msgs/msg/Imu", message, target, stamp_ns)


def joints(value: Joints, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``sensor_msgs/JointState``; without names the joints are numbered."""
    message = types.make(
        "sensor_msgs/JointState",
        header=types.header(stamp_ns, target.new_frame(target.frame)),
        name=list(value.names) or [str(i) for i in range(len(value.elements))],
        position=np.array([state.position for state in value.elements]),
        velocity=np.array([state.speed for state in value.elements]),
        effort=np.array([state.effort for state in value.elements]),
    )
    return single("sensor_msgs/msg/JointState", message, target, stamp_ns)


def cloud(value: LidarScan, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``sensor_msgs/PointCloud2``: x, y, z; if known intensity, ring and t (ns after the stamp)."""
    offsets_ns = value.time_offset_us.astype(np.int64) * 1000 + (value.t0_ns - stamp_ns)
    columns: list[tuple[str, int, Any]] = [(axis, 7, value.points_m[:, i]) for i, axis in enumerate("xyz")]
    if value.intensity is not None:
        columns.append(("intensity", 4, value.intensity))
    if value.ring is not None:
        columns.append(("ring", 4, value.ring))
    if offsets_ns.any():
        columns.append(("t", 6 if offsets_ns.min() >= 0 else 5, offsets_ns))
    kinds = {4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4"}
    dtype = np.dtype([(name, kinds[number]) for name, number, _ in columns])
    assert dtype.fields is not None
    points = np.empty(len(value.points_m), dtype)
    for name, _, column in columns:
        points[name] = column
    message = types.make(
        "sensor_msgs/PointCloud2",
        header=types.header(stamp_ns, target.new_frame(value.frame)),
        height=1,
        width=len(points),
        fields=[
            types.make(
                "sensor_msgs/PointField", name=name, offset=dtype.fields[name][1], datatype=number, count=1
            )
            for name, number, _ in columns
        ],
        is_bigendian=False,
        point_step=dtype.itemsize,
        row_step=dtype.itemsize * len(points),
        data=points.view(np.uint8) if len(points) else np.zeros(0, np.uint8),
        is_dense=bool(np.isfinite(value.points_m).all()),
    )
    return single("sensor_msgs/msg/PointCloud2", message, target, stamp_ns)


def odometry(value: TransformWithCovariance, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``nav_msgs/Odometry`` without velocity; a covariance of zeros is unknown, as ROS defines."""
    parent, child = (target.new_frame(f) for f in (value.parent_frame, value.child_frame))
    zero = types.vector(np.zeros(3))
    message = types.make(
        "nav_msgs/Odometry",
        header=types.header(stamp_ns, parent),
        child_frame_id=child,
        pose=types.make(
            "geometry_msgs/PoseWithCovariance", pose=_pose(value, types), covariance=_covariance(value)
        ),
        twist=types.make(
            "geometry_msgs/TwistWithCovariance",
            twist=types.make("geometry_msgs/Twist", linear=zero, angular=zero),
            covariance=np.zeros(36),
        ),
    )
    return single("nav_msgs/msg/Odometry", message, target, stamp_ns)


def pose_stamped(value: TransformWithCovariance, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``geometry_msgs/PoseStamped``, which has no covariance."""
    header = types.header(stamp_ns, target.new_frame(value.parent_frame))
    message = types.make("geometry_msgs/PoseStamped", header=header, pose=_pose(value, types))
    return single("geometry_msgs/msg/PoseStamped", message, target, stamp_ns)


def pose_with_covariance(
    value: TransformWithCovariance, target: Target, types: RosTypes, stamp_ns: int
) -> Encoded:
    """Return ``geometry_msgs/PoseWithCovarianceStamped``; zeros are an unknown covariance."""
    pose = types.make(
        "geometry_msgs/PoseWithCovariance", pose=_pose(value, types), covariance=_covariance(value)
    )
    header = types.header(stamp_ns, target.new_frame(value.parent_frame))
    message = types.make("geometry_msgs/PoseWithCovarianceStamped", header=header, pose=pose)
    return single("geometry_msgs/msg/PoseWithCovarianceStamped", message, target, stamp_ns)


def transform_stamped(
    value: TransformWithCovariance, target: Target, types: RosTypes, stamp_ns: int
) -> Encoded:
    """Return ``geometry_msgs/TransformStamped``, which has no covariance."""
    message = transform_message(value, target, types, stamp_ns)
    return single("geometry_msgs/msg/TransformStamped", message, target, stamp_ns)


def transform_message(value: TransformWithCovariance, target: Target, types: RosTypes, stamp_ns: int) -> Any:
    """Return ``geometry_msgs/TransformStamped`` of a pose."""
    return types.make(
        "geometry_msgs/TransformStamped",
        header=types.header(stamp_ns, target.new_frame(value.parent_frame)),
        child_frame_id=target.new_frame(value.child_frame),
        transform=types.make(
            "geometry_msgs/Transform",
            translation=types.vector(value.data.translation),
            rotation=types.quaternion(value.data.orientation),
        ),
    )


def fix(value: TransformWithCovariance, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``sensor_msgs/NavSatFix`` of a position in a frame with a known location on the Earth."""
    if target.local_frame is None:
        raise InputError(f"{target.topic}: the location of {value.parent_frame} on the Earth is not known")
    message = types.make(
        FIX.replace("/msg/", "/"),
        header=types.header(stamp_ns, target.new_frame(value.child_frame)),
        status=types.make("sensor_msgs/NavSatStatus", status=0, service=1),
        **fix_fields(value, target.local_frame),
    )
    return single(FIX, message, target, stamp_ns)


def _pose(value: TransformWithCovariance, types: RosTypes) -> Any:
    return types.make(
        "geometry_msgs/Pose",
        position=types.vector(value.data.translation, "Point"),
        orientation=types.quaternion(value.data.orientation),
    )


def _covariance(value: TransformWithCovariance) -> Any:
    cov = value.data.cov
    return np.zeros(36) if np.isnan(cov).any() else np.ravel(cov).astype(np.float64)


def bitstream(value: Any, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return any value as ``infuse_msgs/Asn1Bitstream``, the message of the InFuse robots (unaligned PER)."""
    wrapped = wrap(value)
    message = types.make(
        "infuse_msgs/Asn1Bitstream",
        header=types.header(stamp_ns, target.new_frame(target.frame)),
        type=wrapped.type,
        serialization_method=wrapped.serialization_method,
        data=wrapped.data,
    )
    encoded = single(BITSTREAM, message, target, stamp_ns)
    return Encoded(encoded.messages, value, encoded.read_as)


def _encoders() -> dict[str, dict[str, Encoder]]:
    """Return the encoders of the table, by type and message; the first message of a type is its default."""
    found: dict[str, dict[str, Encoder]] = {}
    for type_name, entries in mapping_table().writers().items():
        if type_name == BITSTREAM_TYPE:
            continue
        known = found.setdefault(type_name, {})
        if not any(entry.is_default for entry in entries):
            known[BITSTREAM] = bitstream
        for entry in sorted(entries, key=lambda e: not e.is_default):
            assert entry.write is not None
            known[entry.message] = function(entry.write)
    return found


#: Encoders by type and message. Types that are not listed become bitstreams.
ENCODERS = _encoders()


def encoder(type_name: str, message: str) -> Encoder:
    """Return the encoder of a type to a message type, or to its default one.

    Raises
    ------
    InputError
        If the type has no such message.
    """
    known = ENCODERS.get(type_name, {})
    if message in ("", next(iter(known), "")):
        return next(iter(known.values()), bitstream)
    if message == BITSTREAM:
        return bitstream
    if message not in known:
        raise InputError(
            f"--map: message {message} for a {type_name}: expected {', '.join((*known, BITSTREAM))}"
        )
    return known[message]

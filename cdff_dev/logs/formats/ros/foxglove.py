# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of Foxglove's schemas as messages of ROS, for the conversions of these.

The schemas are the same in protobuf and JSON (https://docs.foxglove.dev/docs/sdk/schemas), except times, and
bytes, which are base 64 in JSON.
"""

from __future__ import annotations

import base64
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError

#: Type of a field in ``sensor_msgs/PointField`` by that of Foxglove.
_POINT_TYPES = {1: 2, 2: 1, 3: 4, 4: 3, 5: 6, 6: 5, 7: 7, 8: 8}


def _header(message: Any, frame: str = "frame_id") -> SimpleNamespace:
    time = message.timestamp
    if hasattr(time, "seconds"):
        stamp = SimpleNamespace(sec=time.seconds, nanosec=time.nanos)
    else:
        stamp = SimpleNamespace(sec=int(time.sec), nanosec=int(time.nsec))
    return SimpleNamespace(stamp=stamp, frame_id=getattr(message, frame))


def _bytes(data: Any) -> NDArray[np.uint8]:
    return np.frombuffer(base64.b64decode(data, validate=True) if isinstance(data, str) else data, np.uint8)


def _cloud(message: Any) -> Any:
    data = _bytes(message.data)
    if message.point_stride <= 0 or data.size % message.point_stride:
        raise InputError(f"{data.size} bytes of points of {message.point_stride} bytes")
    width = data.size // message.point_stride
    unknown = [f.type for f in message.fields if f.type not in _POINT_TYPES]
    if unknown:
        raise InputError(f"field of numeric type {unknown[0]}: expected 1 to 8")
    return SimpleNamespace(
        header=_header(message),
        height=1,
        width=width,
        fields=[
            SimpleNamespace(name=f.name, offset=f.offset, datatype=_POINT_TYPES[f.type], count=1)
            for f in message.fields
        ],
        is_bigendian=False,
        point_step=message.point_stride,
        row_step=data.size,
        data=data,
        pose=message.pose,
    )


def _laser_scan(message: Any) -> Any:
    steps = max(len(message.ranges) - 1, 1)
    return SimpleNamespace(
        header=_header(message),
        angle_min=message.start_angle,
        angle_increment=(message.end_angle - message.start_angle) / steps,
        time_increment=0.0,
        range_min=0.0,
        range_max=np.inf,
        ranges=message.ranges,
        intensities=message.intensities,
        pose=message.pose,
    )


def _raw_image(message: Any) -> Any:
    return SimpleNamespace(
        header=_header(message),
        height=message.height,
        width=message.width,
        encoding=message.encoding,
        is_bigendian=False,
        step=message.step,
        data=_bytes(message.data),
    )


def _compressed_image(message: Any) -> Any:
    return SimpleNamespace(header=_header(message), format=message.format, data=_bytes(message.data))


def _camera(message: Any) -> Any:
    return SimpleNamespace(
        header=_header(message),
        height=message.height,
        width=message.width,
        distortion_model=message.distortion_model,
        **{name: np.array(getattr(message, name), np.float64) for name in "DKRP"},
    )


def _pose(message: Any) -> Any:
    return SimpleNamespace(header=_header(message), pose=message.pose)


def _odometry(message: Any) -> Any:
    covariance = np.array(message.pose_covariance, np.float64)
    pose = SimpleNamespace(pose=message.pose, covariance=covariance if covariance.size else np.zeros(36))
    body = getattr(message, "body_frame_id", "") or getattr(message, "child_frame_id", "")  # until 2026
    return SimpleNamespace(header=_header(message), child_frame_id=body, pose=pose)


def _joints(message: Any) -> Any:
    header = _header(SimpleNamespace(timestamp=message.timestamp, frame_id="joints"))
    columns = {
        name: [_optional(joint, name) for joint in message.joints]
        for name in ("name", "position", "velocity", "effort")
    }
    return SimpleNamespace(header=header, **columns)


def _optional(message: Any, name: str) -> Any:
    """Return a field, or NaN if it is absent."""
    is_unset = hasattr(message, "HasField") and name != "name" and not message.HasField(name)
    return np.nan if is_unset else getattr(message, name, np.nan)


def _transform(message: Any) -> Any:
    return SimpleNamespace(
        header=_header(message, "parent_frame_id"),
        child_frame_id=message.child_frame_id,
        transform=SimpleNamespace(translation=message.translation, rotation=message.rotation),
    )


def _fix(message: Any) -> Any:
    """Return a position; the schema has no status. JSON may lack the covariance."""
    covariance = np.array(getattr(message, "position_covariance", ()), np.float64)
    return SimpleNamespace(
        header=_header(message),
        status=SimpleNamespace(status=0, service=0),
        latitude=message.latitude,
        longitude=message.longitude,
        altitude=message.altitude,
        position_covariance=covariance if covariance.size else np.zeros(9),
        position_covariance_type=int(getattr(message, "position_covariance_type", 0)),
    )


def _one_transform(message: Any) -> Any:
    return SimpleNamespace(transforms=[_transform(message)])


def _transforms(message: Any) -> Any:
    return SimpleNamespace(transforms=[_transform(part) for part in message.transforms])


def _same(message: Any) -> Any:
    return message


#: ROS type by the name of a Foxglove schema, and the function that converts a decoded message to the fields
#: of that type.
FOXGLOVE: dict[str, tuple[str, Callable[[Any], Any]]] = {
    "foxglove.PointCloud": ("sensor_msgs/msg/PointCloud2", _cloud),
    "foxglove.LaserScan": ("sensor_msgs/msg/LaserScan", _laser_scan),
    "foxglove.RawImage": ("sensor_msgs/msg/Image", _raw_image),
    "foxglove.CompressedImage": ("sensor_msgs/msg/CompressedImage", _compressed_image),
    "foxglove.CameraCalibration": ("sensor_msgs/msg/CameraInfo", _camera),
    "foxglove.PoseInFrame": ("geometry_msgs/msg/PoseStamped", _pose),
    "foxglove.Odometry": ("nav_msgs/msg/Odometry", _odometry),
    "foxglove.JointStates": ("sensor_msgs/msg/JointState", _joints),
    "foxglove.FrameTransform": ("tf2_msgs/msg/TFMessage", _one_transform),
    "foxglove.FrameTransforms": ("tf2_msgs/msg/TFMessage", _transforms),
    "foxglove.LocationFix": ("sensor_msgs/msg/NavSatFix", _fix),
    "foxglove.PosesInFrame": ("nav_msgs/msg/Path", _same),
}

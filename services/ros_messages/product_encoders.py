# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages of ROS for velocities, paths, planar scans, detections, states, PNG images and the clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import msgpack
import numpy as np

from cdff_common.errors import InputError
from cdff_common.types import (
    DfpcStateT,
    DfpcStatus,
    Event,
    Frame,
    LaserScan,
    ObjectDetections,
    PoseTrajectory,
    Time,
    TransformWithCovariance,
    TwistWithCovariance,
)
from services.ros_messages.diagnostics import DIAGNOSTICS
from services.ros_messages.encoding import Encoded, Outgoing, Target, single
from services.ros_messages.image_encoders import frame_images
from services.ros_messages.message_types import RosTypes

#: Levels of ``diagnostic_msgs/DiagnosticStatus``.
_OK, _WARN, _ERROR, _STALE = 0, 1, 2, 3
_LEVELS = {
    DfpcStateT.DFPC_UNCONFIGURED: _STALE,
    DfpcStateT.DFPC_INACTIVE: _STALE,
    DfpcStateT.DFPC_ACTIVE: _OK,
    DfpcStateT.DFPC_ERROR: _ERROR,
}
_COUNTERS = ("samples", "outputs", "degraded", "failed", "dropped", "malformed")
#: Codes of ranges of LaserScan below the first distance, millimetres: too far is 0.
_TOO_FAR, _FIRST_RANGE = 0, 5
_NS_PER_S = 1_000_000_000


def twist(value: TwistWithCovariance, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``geometry_msgs/TwistStamped``, which has no covariance."""
    header = types.header(stamp_ns, target.new_frame(target.frame))
    message = types.make("geometry_msgs/TwistStamped", header=header, twist=_twist(value, types))
    return single("geometry_msgs/msg/TwistStamped", message, target, stamp_ns)


def twist_with_covariance(
    value: TwistWithCovariance, target: Target, types: RosTypes, stamp_ns: int
) -> Encoded:
    """Return ``geometry_msgs/TwistWithCovarianceStamped``; zeros are an unknown covariance."""
    cov = value.data.cov
    covariance = np.zeros(36) if np.isnan(cov).any() else np.ravel(cov).astype(np.float64)
    message = types.make(
        "geometry_msgs/TwistWithCovarianceStamped",
        header=types.header(stamp_ns, target.new_frame(target.frame)),
        twist=types.make(
            "geometry_msgs/TwistWithCovariance", twist=_twist(value, types), covariance=covariance
        ),
    )
    return single("geometry_msgs/msg/TwistWithCovarianceStamped", message, target, stamp_ns)


def _twist(value: TwistWithCovariance, types: RosTypes) -> Any:
    return types.make(
        "geometry_msgs/Twist", linear=types.vector(value.data.vel), angular=types.vector(value.data.rot)
    )


def path(value: PoseTrajectory, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``nav_msgs/Path`` with a time for each pose."""
    frame_id = target.new_frame(value.metadata.parent_frame_id)
    poses = [
        types.make(
            "geometry_msgs/PoseStamped",
            header=types.header(int(pose_ns), frame_id),
            pose=types.make(
                "geometry_msgs/Pose",
                position=types.vector(row[:3], "Point"),
                orientation=types.quaternion(row[3:]),
            ),
        )
        for pose_ns, row in zip(value.stamps_ns, value.data.poses, strict=True)
    ]
    message = types.make("nav_msgs/Path", header=types.header(stamp_ns, frame_id), poses=poses)
    return single("nav_msgs/msg/Path", message, target, stamp_ns)


def laser_scan(value: LaserScan, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``sensor_msgs/LaserScan``; codes of ranges become infinite (too far) or NaN."""
    codes = value.ranges
    ranges_m = np.where(codes >= _FIRST_RANGE, codes * 1e-3, np.nan)
    ranges_m[codes == _TOO_FAR] = np.inf
    step = value.angular_resolution
    has_time = value.speed != 0.0 and np.isfinite(value.speed)
    message = types.make(
        "sensor_msgs/LaserScan",
        header=types.header(stamp_ns, target.new_frame(target.frame)),
        angle_min=value.start_angle,
        angle_max=value.start_angle + step * (len(codes) - 1),
        angle_increment=step,
        time_increment=abs(step / value.speed) if has_time else 0.0,
        scan_time=0.0,
        range_min=value.min_range * 1e-3,
        range_max=value.max_range * 1e-3,
        ranges=ranges_m.astype(np.float32),
        intensities=np.asarray(value.remission, np.float32),
    )
    return single("sensor_msgs/msg/LaserScan", message, target, stamp_ns)


def detections(value: ObjectDetections, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``vision_msgs/Detection3DArray``: one hypothesis for each detection.

    Raises
    ------
    InputError
        In ROS 1, whose message has no classes; or if a detection has no pose in space.
    """
    if types.version == 1:
        raise InputError(f"{target.topic}: vision_msgs of ROS 1 have no names of classes; expected ROS 2")
    header = types.header(stamp_ns, target.new_frame(value.frame_id))
    items = []
    for item in value.detections:
        if not item.pose.is_set:
            raise InputError(f"{target.topic}: detection of {item.label!r} without a pose, expected one")
        pose = _pose(item.pose, types)
        cov = item.pose.data.cov
        covariance = np.zeros(36) if np.isnan(cov).any() else np.ravel(cov).astype(np.float64)
        result = types.make(
            "vision_msgs/ObjectHypothesisWithPose",
            hypothesis=types.make("vision_msgs/ObjectHypothesis", class_id=item.label, score=item.score),
            pose=types.make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=covariance),
        )
        box = types.make("vision_msgs/BoundingBox3D", center=pose, size=types.vector(item.size))
        items.append(types.make("vision_msgs/Detection3D", header=header, results=[result], bbox=box, id=""))
    message = types.make("vision_msgs/Detection3DArray", header=header, detections=items)
    return single("vision_msgs/msg/Detection3DArray", message, target, stamp_ns)


def _pose(value: TransformWithCovariance, types: RosTypes) -> Any:
    return types.make(
        "geometry_msgs/Pose",
        position=types.vector(value.data.translation, "Point"),
        orientation=types.quaternion(value.data.orientation),
    )


def diagnostics(value: Event, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``diagnostic_msgs/DiagnosticArray`` of an event.

    Raises
    ------
    InputError
        If the body of the event is no MessagePack map.
    """
    try:
        body = msgpack.unpackb(value.body.tobytes())
        if not isinstance(body, dict):
            raise TypeError(f"a {type(body).__name__}")
        if value.kind == DIAGNOSTICS:
            frame_id, states = str(body["frame"]), [_status(state, types) for state in body["status"]]
        else:
            pairs = [(str(key), str(item)) for key, item in body.items()]
            frame_id, states = "", [_state(types, _OK, value.kind, "", value.scope, pairs)]
    except (msgpack.exceptions.UnpackException, LookupError, TypeError, ValueError) as error:
        raise InputError(
            f"{target.topic}: body of the event {value.kind}: {error}; expected a map"
        ) from error
    return _diagnostics(frame_id, states, target, types, stamp_ns)


def dfpc_diagnostics(value: DfpcStatus, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``diagnostic_msgs/DiagnosticArray`` with the state of a DFPC."""
    level = _LEVELS[DfpcStateT(value.state)]
    if level == _OK and (value.dropped or value.malformed):
        level = _WARN
    names = ("implementation", "config_hash", *_COUNTERS, "mean_step", "max_step")
    pairs = [(name, str(getattr(value, name))) for name in names]
    text = value.last_error or DfpcStateT(value.state).name.removeprefix("DFPC_").lower()
    state = _state(types, level, f"{value.robot}/{value.dfpc}", text, value.robot, pairs)
    return _diagnostics("", [state], target, types, stamp_ns)


def _status(state: Mapping[str, Any], types: RosTypes) -> Any:
    pairs = [(str(key), str(item)) for key, item in state["values"]]
    name, text, hardware_id = (str(state[key]) for key in ("name", "message", "hardware_id"))
    level = int(state["level"])
    if not 0 <= level < 256:
        raise ValueError(f"level {level}")
    return _state(types, level, name, text, hardware_id, pairs)


def _state(
    types: RosTypes, level: int, name: str, text: str, hardware_id: str, pairs: Sequence[tuple[str, str]]
) -> Any:
    return types.make(
        "diagnostic_msgs/DiagnosticStatus",
        level=level,
        name=name,
        message=text,
        hardware_id=hardware_id,
        values=[types.make("diagnostic_msgs/KeyValue", key=key, value=item) for key, item in pairs],
    )


def _diagnostics(frame_id: str, states: list[Any], target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    header = types.header(stamp_ns, frame_id)
    message = types.make("diagnostic_msgs/DiagnosticArray", header=header, status=states)
    return single("diagnostic_msgs/msg/DiagnosticArray", message, target, stamp_ns)


def compressed_image(value: Frame, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``sensor_msgs/CompressedImage`` (PNG) with the calibration of the image.

    Raises
    ------
    InputError
        If PNG cannot hold the pixels without loss.
    """
    import cv2

    encoded = frame_images(value, target, types, stamp_ns)
    raw, *calibration = encoded.messages
    image = value.image
    if image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{target.topic}: PNG of {image.dtype} pixels; expected 8 or 16 bits")
    is_rgb = raw.message.encoding == "rgb8"
    pixels = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if is_rgb else np.ascontiguousarray(image)
    _, data = cv2.imencode(".png", pixels)
    message = types.make(
        "sensor_msgs/CompressedImage",
        header=raw.message.header,
        format=f"{raw.message.encoding}; png compressed {'bgr8' if image.ndim == 3 else ''}".rstrip(),
        data=np.asarray(data, np.uint8).reshape(-1),
    )
    out = Outgoing(f"{raw.topic}/compressed", "sensor_msgs/msg/CompressedImage", message)
    return Encoded((out, *calibration), encoded.held, encoded.read_as)


def clock(value: Time, target: Target, types: RosTypes, stamp_ns: int) -> Encoded:
    """Return ``rosgraph_msgs/Clock``."""
    now_ns = value.ns
    time = types.make("builtin_interfaces/Time", sec=now_ns // _NS_PER_S, nanosec=now_ns % _NS_PER_S)
    return single("rosgraph_msgs/msg/Clock", types.make("rosgraph_msgs/Clock", clock=time), target, stamp_ns)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Positions of satellite navigation: ``sensor_msgs/NavSatFix`` and positions in a local frame.

The local frame is z up, x east and y north, and its origin is the first position of the recording, unless the
recording states another. Its pose in the body frame of the Earth, ``earth`` (as in REP 105), is a stream with
a sample for each position, so that every part of a log states it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import TransformWithCovariance
from services.ros_messages.topics import Topic

#: Message type, and the frame of its positions, which are above the ellipsoid of WGS 84.
FIX = "sensor_msgs/msg/NavSatFix"
EARTH = "earth"
#: Local frame of a recording, without the robot.
LOCAL_FRAME = "enu"
#: Decimals of positions, metres. Degrees in 64 bits have a resolution of 2e-9 m: rounded positions are equal
#: after a conversion to degrees and back.
_DECIMALS = 7
_UNKNOWN_COVARIANCE, _KNOWN_COVARIANCE = 0, 3
#: Standard deviation of the orientation, which a receiver does not measure.
_SIGMA_RAD = np.pi


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """Frame of positions: its name in the messages, and its location."""

    frame_id: str
    anchor: Anchor

    @classmethod
    def at(cls, message: Any) -> LocalFrame:
        """Return the frame whose origin is the position of a message."""
        return cls(LOCAL_FRAME, Anchor(body(EARTH), message.longitude, message.latitude, message.altitude))

    @classmethod
    def of_transform(cls, frame_id: str, T_earth_frame: FloatArray) -> LocalFrame:
        """Return a frame with a known pose in the body frame; raises InputError if it is not level."""
        anchor = Anchor.from_transform(body(EARTH), T_earth_frame)
        if not np.allclose(anchor.T_body_frame, T_earth_frame, rtol=0.0, atol=1e-6):
            raise InputError(f"frame {frame_id!r}: its z axis is not the vertical of its origin")
        return cls(frame_id, anchor)

    @classmethod
    def from_row(cls, row: tuple[str, float, float, float, float]) -> LocalFrame:
        """Return the frame of ``row``."""
        return cls(row[0], Anchor(body(EARTH), *row[1:]))

    @property
    def row(self) -> tuple[str, float, float, float, float]:
        """Name; longitude, latitude (degrees), height (metres) and azimuth (degrees) of ``anchor``."""
        a = self.anchor
        return self.frame_id, a.lon_deg, a.lat_deg, a.height_m, a.azimuth_deg

    def rotation_at(self, position_m: FloatArray) -> FloatArray:
        """Return the rotation ``(3, 3)`` from east, north, up at a position to the axes of this frame."""
        lon_deg, lat_deg, height_m = self.anchor.lonlat(position_m[None])[0]
        T_earth_horizon = Anchor(self.anchor.body, lon_deg, lat_deg, height_m).T_body_frame
        return np.asarray(self.anchor.T_body_frame[:3, :3].T @ T_earth_horizon[:3, :3])


def no_position(message: Any) -> str:
    """Return why a message has no position; empty if it has one."""
    if message.status.status < 0:
        return "without a fix"
    numbers = np.array([message.longitude, message.latitude], np.float64)
    if not np.isfinite(numbers).all() or abs(numbers[0]) > 360.0 or abs(numbers[1]) > 90.0:
        return "without a longitude and latitude"
    if not np.isfinite(message.altitude) or abs(message.altitude) > 1e6:
        return "without an altitude"
    return ""


def has_covariance(message: Any) -> bool:
    """Return whether a message states a covariance that is one."""
    C = _covariance(message)
    return bool(
        message.position_covariance_type != _UNKNOWN_COVARIANCE
        and np.isfinite(C).all()
        and np.allclose(C, C.T)
        and np.linalg.eigvalsh(C)[0] >= -1e-9 * np.abs(C).max()
    )


def _covariance(message: Any) -> FloatArray:
    return np.asarray(message.position_covariance, np.float64).reshape(3, 3)


def position(message: Any, topic: Topic, stamp_ns: int) -> tuple[TransformWithCovariance, str, str]:
    """Return the position of the receiver in the local frame.

    Its orientation is the unit quaternion, marked as not estimated, with a standard deviation of 180 degrees;
    the covariance is NaN if the message does not state one.
    """
    local = _local_frame(topic)
    coordinates = [[message.longitude, message.latitude, message.altitude]]
    position_m = np.round(local.anchor.points(coordinates)[0], _DECIMALS) + 0.0
    covariance = None
    if has_covariance(message):
        covariance = np.diag([0.0] * 3 + [_SIGMA_RAD**2] * 3)
        R = local.rotation_at(position_m)
        covariance[:3, :3] = R @ _covariance(message) @ R.T
    T = UncertainTransform(se3.transform(np.eye(3), position_m), covariance)
    parent, child = topic.frame(local.frame_id), topic.frame(message.header.frame_id)
    value = TransformWithCovariance.from_transform(
        T, parent=parent, child=child, stamp_ns=stamp_ns, producer=topic.robot
    )
    metadata = replace(value.metadata, data_estimated=np.array([True] * 3 + [False] * 4))
    return replace(value, metadata=metadata), parent, child


def local_frame_pose(_: Any, topic: Topic, stamp_ns: int) -> tuple[TransformWithCovariance, str, str]:
    """Return the pose of the local frame in the body frame of the Earth, without a covariance."""
    local = _local_frame(topic)
    child = topic.frame(local.frame_id)
    value = TransformWithCovariance.from_transform(
        UncertainTransform(local.anchor.T_body_frame),
        parent=EARTH,
        child=child,
        stamp_ns=stamp_ns,
        producer=topic.robot,
    )
    return value, EARTH, child


def _local_frame(topic: Topic) -> LocalFrame:
    if topic.local_frame is None:
        raise InputError(f"{topic.name}: no message has a position")
    return topic.local_frame


def is_position(value: Any) -> bool:
    """Return whether a pose is a position, of which the orientation is not estimated."""
    if not isinstance(value, TransformWithCovariance):
        return False
    is_estimated = value.metadata.data_estimated
    return bool(is_estimated[:3].all() and not is_estimated[3:].any())


def fix_fields(value: TransformWithCovariance, local: LocalFrame) -> dict[str, Any]:
    """Return the fields of the message of a position in a local frame, without its header."""
    position_m = np.asarray(value.data.translation, np.float64)
    lon_deg, lat_deg, height_m = (float(x) for x in local.anchor.lonlat(position_m[None])[0])
    C = np.asarray(value.data.cov)[:3, :3]
    is_known = bool(np.isfinite(value.data.cov).all())
    R = local.rotation_at(position_m)
    C_horizon = R.T @ C @ R if is_known else np.zeros((3, 3))
    return {
        "latitude": lat_deg,
        "longitude": lon_deg,
        "altitude": height_m,
        "position_covariance": C_horizon.ravel(),
        "position_covariance_type": _KNOWN_COVARIANCE if is_known else _UNKNOWN_COVARIANCE,
    }

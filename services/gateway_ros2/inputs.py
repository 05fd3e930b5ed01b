# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Topics of the robot that become samples of sensors on the bus."""

from __future__ import annotations

import logging
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from rosbags.serde import SerdeError

from cdff_common import types
from cdff_common.bus import Bus, Message
from cdff_common.client import Sensor
from cdff_common.clock import MAX_STAMP_NS, monotonic_s
from cdff_common.errors import CdffError, InputError
from cdff_common.types import TransformWithCovariance
from services.gateway_ros2.counters import RateLimit, TopicCounters
from services.gateway_ros2.rmw_zenoh import NO_HASH
from services.gateway_ros2.settings import InputTopic
from services.ros_messages.conversions import CAMERA_INFO, CONVERSIONS
from services.ros_messages.message_types import RosTypes
from services.ros_messages.topics import Topic

logger = logging.getLogger(__name__)

#: Errors of the decoder for damaged messages; MemoryError for stated lengths that no message has.
_DECODER_ERRORS = (
    ArithmeticError,
    AssertionError,
    LookupError,
    MemoryError,
    SerdeError,
    TypeError,
    ValueError,
    struct.error,
)
_NS_PER_S = 1_000_000_000


@dataclass(frozen=True, slots=True)
class _RobotTopic(Topic):
    """A topic of the robot with the frames of CDFF by their ``frame_id``."""

    frames: Mapping[str, str] = field(default_factory=dict)

    def frame(self, frame_id: str) -> str:
        """Return the frame in CDFF."""
        return self.frames.get(frame_id) or super(_RobotTopic, self).frame(frame_id)


class InputLink:
    """A topic and the sensor stream that it becomes.

    Parameters
    ----------
    entry : InputTopic
    robot : str
    frames : mapping of str to str
        Frames of CDFF by their ``frame_id``.
    ros_types : RosTypes
    type_hash : str
        Hash of the message type.
    bus : Bus
        Bus of the samples.
    """

    def __init__(
        self,
        entry: InputTopic,
        robot: str,
        frames: Mapping[str, str],
        ros_types: RosTypes,
        type_hash: str,
        bus: Bus,
    ) -> None:
        self.entry, self.type_hash, self.counters = entry, type_hash, TopicCounters()
        self._ros_types = ros_types
        conversion = CONVERSIONS[entry.type]
        self._topic = _RobotTopic(entry.topic, robot, conversion, frames=frames)
        self._rate = RateLimit(entry.max_hz)
        self.sensor = Sensor(
            entry.stream,
            getattr(types, conversion.type_name),
            frame=entry.frame,
            child=entry.child,
            robot=robot,
            bus=bus,
            on_clock_fault=entry.on_clock_fault,
        )

    def close(self) -> None:
        """Send the waiting samples."""
        self.sensor.close()

    def on_camera_info(self, message: Message) -> None:
        """Take the calibration for the images that follow."""
        info, _ = self._decoded(message, CAMERA_INFO)
        if info is not None:
            self._topic = replace(self._topic, camera=info)

    def on_message(self, message: Message) -> None:
        """Convert a message and send it as a sample; a message with a fault is counted and dropped."""
        start_s = monotonic_s()
        self.counters.receive(len(message.payload))
        if not self._rate.admits(start_s):
            self._drop("rate", f"more than {self.entry.max_hz:g} messages per second")
            return
        type_hash = message.key.rpartition("/")[2]
        if type_hash not in (self.type_hash, NO_HASH):
            self._drop("type_hash", f"type hash {type_hash}, expected {self.type_hash} of {self.entry.type}")
            return
        decoded, stamp_ns = self._decoded(message, self.entry.type)
        if decoded is None:
            return
        try:
            value, frame, child = self._topic.conversion.convert(decoded, self._topic, stamp_ns)
            _check_finite(value)
            self._check_frames(frame, child)
            own_ns = getattr(value, "stamp_ns", 0)
            is_sent = self.sensor.publish(value) if own_ns else self.sensor.publish(value, stamp_ns)
        except (CdffError, *_DECODER_ERRORS) as error:
            self._drop("content", f"{type(error).__name__}: {error}")
            return
        if is_sent:
            self.counters.forward(monotonic_s() - start_s)
        else:
            fault = self.sensor.status.last_fault
            is_off = not self.sensor.mode.on
            self._drop("sensor_off" if is_off else "clock", "sensor is off" if is_off else str(fault))

    def _decoded(self, message: Message, type_name: str) -> tuple[Any, int]:
        """Return a message and its stamp, multiples of 1 µs; count one with a fault, and return None."""
        if len(message.payload) > self.entry.max_bytes:
            self._drop("size", f"{len(message.payload)} bytes, expected at most {self.entry.max_bytes}")
            return None, 0
        try:
            decoded: Any = self._ros_types.store.deserialize_cdr(message.payload, type_name)
            stamp = decoded.header.stamp
            stamp_ns = (stamp.sec * _NS_PER_S + stamp.nanosec) // 1000 * 1000
            if not 0 < stamp_ns <= MAX_STAMP_NS:
                raise InputError(f"stamp {stamp_ns} ns: expected a time of capture since 1970")
        except (CdffError, *_DECODER_ERRORS) as error:
            self._drop("decoding", f"{len(message.payload)} bytes of {type_name}: {error}")
            return None, 0
        return decoded, stamp_ns

    def _check_frames(self, frame: str, child: str | None) -> None:
        if (frame, child) != (self.entry.frame, self.entry.child):
            raise InputError(
                f"frames {frame} and {child}: expected {self.entry.frame} and {self.entry.child}; "
                "see frames in the settings"
            )

    def _drop(self, reason: str, detail: str) -> None:
        if self.counters.drop(reason, detail):
            logger.warning("%s: dropped (%s): %s", self.entry.topic, reason, detail)


def _check_finite(value: Any) -> None:
    if isinstance(value, TransformWithCovariance):
        numbers = (value.data.translation, value.data.orientation)
        if not all(np.isfinite(part).all() for part in numbers):
            raise InputError("pose that is not finite")

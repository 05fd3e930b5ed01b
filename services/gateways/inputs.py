# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Topics of the robot that become samples of sensors on the bus."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from rosbags.serde import SerdeError

from cdff_common.bus import Bus
from cdff_common.clock import MAX_STAMP_NS, monotonic_s
from cdff_common.errors import CdffError, InputError
from services.gateways.counters import RateLimit
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.sample_link import CONVERSION_ERRORS, SampleLink
from services.gateways.settings import STATIC_TRANSFORMS, InputTopic
from services.ros_messages.conversions import CAMERA_INFO, CONVERSIONS
from services.ros_messages.fixes import FIX, no_position
from services.ros_messages.maps import header_of
from services.ros_messages.message_types import RosTypes
from services.ros_messages.topics import Topic

#: Errors of the decoder for damaged messages.
DECODER_ERRORS = (*CONVERSION_ERRORS, SerdeError)
_NS_PER_S = 1_000_000_000
#: Largest rate of the messages of the further topics of an input, per second.
_MAX_FURTHER_HZ = 1000.0


@dataclass(frozen=True, slots=True)
class _RobotTopic(Topic):
    """A topic of the robot with the frames of CDFF by their ``frame_id``."""

    frames: Mapping[str, str] = field(default_factory=dict)

    def frame(self, frame_id: str) -> str:
        """Return the frame in CDFF."""
        return self.frames.get(frame_id) or super(_RobotTopic, self).frame(frame_id)


class FurtherTopic(NamedTuple):
    """A second topic of an input, such as that of the calibration of a camera: ``receive`` takes messages."""

    topic: str
    type_name: str
    receive: Callable[[bytes], None]
    queue: int


class InputLink(SampleLink):
    """A topic and the sensor stream that it becomes.

    Parameters
    ----------
    entry : InputTopic
    names : FrameNames
    ros_types : RosTypes
    bus : Bus
        Bus of the samples.
    tree : FrameTree
        Frames of all transforms of the robot, the gateway and the DPM.
    """

    def __init__(
        self, entry: InputTopic, names: FrameNames, ros_types: RosTypes, bus: Bus, tree: FrameTree
    ) -> None:
        conversion = CONVERSIONS[entry.type]
        type_name = conversion.type_name if entry.right is None else "FramePair"
        super().__init__(entry, entry.topic, type_name, names.robot, bus)
        self.entry, self._ros_types, self._tree, self._names = entry, ros_types, tree, names
        local = names.local_frame(entry.frame) if entry.type == FIX else None
        frames = dict(names.frames) if local is None else {**names.frames, local.frame_id: entry.frame}
        self._topic = _RobotTopic(entry.topic, names.robot, conversion, local_frame=local, frames=frames)

        self._further_rate = RateLimit(_MAX_FURTHER_HZ)

    @property
    def further_topics(self) -> list[FurtherTopic]:
        """Topics that the conversion of the messages of the first one needs."""
        calibration = self.entry.camera_info
        return [] if calibration is None else [FurtherTopic(calibration, CAMERA_INFO, self.on_camera_info, 1)]

    def on_camera_info(self, data: bytes) -> None:
        """Take the calibration for the images that follow."""
        if not self.admits_further():
            return
        info = self._decoded(data, CAMERA_INFO)
        if info is not None:
            self._topic = replace(self._topic, camera=info)

    def admits_further(self) -> bool:
        """Return whether a message of a further topic is within their rate; count it as dropped if not."""
        if self._further_rate.admits():
            return True
        self.drop("rate", f"further topics: more than {_MAX_FURTHER_HZ:g} messages per second")
        return False

    def on_message(self, data: bytes) -> None:
        """Convert a message and send it as a sample; a message with a fault is counted and dropped."""
        start_s = monotonic_s()
        if not self.admits(len(data), start_s):
            return
        decoded = self._decoded(data, self.entry.type)
        if decoded is None:
            return
        try:
            part = self._part(decoded)
            if part is None:
                return
            value, frames, stamp_ns = self._converted(part)
            self.send(value, frames, stamp_ns, start_s)
        except (CdffError, *DECODER_ERRORS) as error:
            self.drop("content", f"{type(error).__name__}: {error}")

    def _part(self, decoded: Any) -> Any:
        """Return the message, or of a frame tree the transform between the frames of the entry, or None."""
        split = self._topic.conversion.split
        if self.entry.type == FIX and (reason := no_position(decoded)):
            raise InputError(f"a position {reason}")
        if split is None:
            return decoded
        found, is_static = None, self.entry.topic == STATIC_TRANSFORMS
        for transform in split(decoded):
            parent, child = (
                self._names.of_cdff(name.lstrip("/"))
                for name in (transform.header.frame_id, transform.child_frame_id)
            )
            is_listed = (parent, child) == (self.entry.frame, self.entry.child)
            try:
                self._tree.add(parent, child, with_dpm=is_listed, is_static=is_static)
            except InputError as error:
                self.drop("frame_tree", str(error))
            else:
                found = transform if is_listed else found
        return found

    def _converted(self, message: Any) -> tuple[Any, tuple[str, str | None], int]:
        """Return a message as a value, its frames and its stamp."""
        stamp_ns = stamp_of(message)
        with np.errstate(over="ignore", invalid="ignore"):  # values that are not finite are refused
            value, frame, child = self._topic.conversion.convert(message, self._topic, stamp_ns)
        return value, (frame, child), stamp_ns

    def _decoded(self, data: bytes, type_name: str) -> Any:
        """Return a message; a faulty message is counted, and None returned."""
        if not self.fits(len(data)):
            return None
        try:
            message = self._ros_types.deserialize(data, type_name)
            if self._topic.conversion.split is None:
                stamp_of(message)
        except (CdffError, *DECODER_ERRORS) as error:
            self.drop("decoding", f"{len(data)} bytes of {type_name}: {error}")
            return None
        return message


def stamp_of(message: Any) -> int:
    """Return the stamp of a message, a multiple of 1 µs; raises InputError without one."""
    stamp = header_of(message).stamp
    stamp_ns: int = (stamp.sec * _NS_PER_S + stamp.nanosec) // 1000 * 1000
    if not 0 < stamp_ns <= MAX_STAMP_NS:
        raise InputError(f"stamp {stamp_ns} ns: expected a time of capture since 1970")
    return stamp_ns

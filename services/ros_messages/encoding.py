# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Interface of the encoders, which make messages of ROS from values of CDFF.

An encoder returns the messages of a sample and the value that the reader makes of them: the writer reports
the fields that the messages do not hold.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from services.ros_messages.conversions import CONVERSIONS
from services.ros_messages.fixes import LocalFrame
from services.ros_messages.message_types import RosTypes
from services.ros_messages.topics import Topic


class Outgoing(NamedTuple):
    """A message on a topic; ``type_name`` such as ``sensor_msgs/msg/Imu``."""

    topic: str
    type_name: str
    message: Any


@dataclass(frozen=True, slots=True, eq=False)
class Encoded:
    """Messages of a sample.

    Attributes
    ----------
    messages : sequence of Outgoing
    held : Any
        The value that the reader makes of the messages.
    read_as : str
        Stream of the reader for these topics, without the robot.
    """

    messages: Sequence[Outgoing]
    held: Any
    read_as: str


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Topic of a stream, and names in its messages.

    Attributes
    ----------
    topic : str
    robot : str
        Robot of the stream.
    frame : str
        Frame in CDFF of values that name none.
    new_frame : callable
        Returns the name of a frame in the messages.
    frames : mapping
        Frames in CDFF by their names in the messages.
    cameras : dict
        First calibration of each camera of the stream, which the reader uses for all its images.
    local_frame : LocalFrame, optional
        Frame of the positions of the stream, by its name in the messages.
    """

    topic: str
    robot: str
    frame: str
    new_frame: Callable[[str], str]
    frames: Mapping[str, str]
    cameras: dict[str, Any]
    local_frame: LocalFrame | None = None


Encoder = Callable[[Any, Target, RosTypes, int], Encoded]


@dataclass(frozen=True, slots=True)
class _WrittenTopic(Topic):
    """A topic that is written, with the frames in CDFF by their names in the messages."""

    frames: Mapping[str, str] = field(default_factory=dict)

    def frame(self, frame_id: str) -> str:
        """Return the frame in CDFF."""
        return self.frames.get(frame_id, frame_id)


def read_back(out: Outgoing, target: Target, stamp_ns: int, camera: Any = None) -> tuple[Any, str]:
    """Return the value that the reader makes of a message, with frames as in CDFF, and its stream."""
    conversion = CONVERSIONS[out.type_name]
    topic = _WrittenTopic(
        out.topic, target.robot, conversion, camera, target.local_frame, frames=target.frames
    )
    value = conversion.convert(out.message, topic, stamp_ns)[0]
    return value, topic.stream.removeprefix(f"/{target.robot}/")


def single(type_name: str, message: Any, target: Target, stamp_ns: int) -> Encoded:
    """Return the encoding of a sample as one message on the topic."""
    out = Outgoing(target.topic, type_name, message)
    return Encoded((out,), *read_back(out, target, stamp_ns))

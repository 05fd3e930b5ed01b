# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway: the topics that may pass, by direction, and their limits."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, ValidationError, model_validator

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.profile import RobotId
from cdff_common.interfaces.sensor_profile import FrameId, Name
from cdff_common.interfaces.yaml_file import read_mapping
from services.ros_messages.conversions import CONVERSIONS
from services.ros_messages.encoders import ENCODERS
from services.ros_messages.fixes import FIX
from services.ros_messages.message_types import BITSTREAM

#: Message type of frame trees.
TF = "tf2_msgs/msg/TFMessage"
_OUTGOING = {message for messages in ENCODERS.values() for message in messages} - {FIX} | {BITSTREAM, TF}
_INCOMING = {name for name, conversion in CONVERSIONS.items() if conversion.split is None} - {FIX}

Topic = Annotated[str, Field(pattern=r"^(/[A-Za-z_][A-Za-z0-9_]*)+$", max_length=255)]
Pair = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*/[a-z][a-z0-9_]*$")]


class InputTopic(StrictModel):
    """A topic of the robot whose messages become samples.

    Attributes
    ----------
    topic, type : str
        Topic, and its message type such as ``sensor_msgs/msg/Imu``.
    stream : str
        Sensor and stream on the bus, such as ``imu/sample``.
    frame, child : str
        Frame of the samples; for a pose the parent and the child frame.
    camera_info : str or None
        For images the topic of the calibration.
    qos : "sensor_data" or "default"
        Quality of service of the subscription.
    max_bytes : int
        Largest message, bytes; larger ones are dropped.
    max_hz : float
        Largest rate, messages per second, with bursts of at most as many as in 0.2 s; others are dropped.
    queue : int
        Messages that can wait; with more the oldest is dropped.
    on_clock_fault : "refuse" or "report"
        Treatment of stamps that are not after the previous one, ahead of mission time or late: the sample is
        not sent, or it is sent with quality DEGRADED.
    """

    topic: Topic
    type: str
    stream: Pair
    frame: FrameId
    child: FrameId | None = None
    camera_info: Topic | None = None
    qos: Literal["sensor_data", "default"] = "sensor_data"
    max_bytes: Annotated[int, Field(gt=0, le=1 << 30)] = 64 << 20
    max_hz: PositiveFloat = 1000.0
    queue: Annotated[int, Field(ge=1, le=1000)] = 16
    on_clock_fault: Literal["refuse", "report"] = "refuse"

    @model_validator(mode="after")
    def _type_is_known(self) -> InputTopic:
        if self.type not in _INCOMING:
            raise ValueError(f"type {self.type!r}: expected one of {', '.join(sorted(_INCOMING))}")
        return self


class OutputTopic(StrictModel):
    """A product that becomes a topic of the robot.

    Attributes
    ----------
    product : str
        DFPC and port, such as ``position_manager/pose``.
    topic, type : str
        Topic, and its message type. ``tf2_msgs/msg/TFMessage`` for a pose is a transform of the frame tree;
        ``infuse_msgs/msg/Asn1Bitstream`` holds any type.
    max_hz : float
        Largest rate, messages per second; others are dropped.
    """

    product: Pair
    topic: Topic
    type: str = BITSTREAM
    max_hz: PositiveFloat = 1000.0

    @model_validator(mode="after")
    def _type_is_known(self) -> OutputTopic:
        if self.type not in _OUTGOING:
            raise ValueError(f"type {self.type!r}: expected one of {', '.join(sorted(_OUTGOING))}")
        return self


class GatewaySettings(StrictModel):
    """Settings of the gateway of a robot. Nothing passes that is not listed.

    Attributes
    ----------
    robot : str
        Robot id.
    domain : int
        ``ROS_DOMAIN_ID`` of the robot.
    node : str
        Name of the gateway's node.
    frames : mapping of str to frame
        Frames of CDFF by their ``frame_id`` of the robot. Without an entry ``lidar`` is ``{robot}/lidar``.
    inputs : list of InputTopic
    outputs : list of OutputTopic
        Empty: the gateway publishes nothing on the robot.
    """

    robot: RobotId
    domain: Annotated[int, Field(ge=0, le=232)] = 0
    node: Name = "cdff_gateway"
    frames: dict[str, FrameId] = {}
    inputs: tuple[InputTopic, ...] = ()
    outputs: tuple[OutputTopic, ...] = ()

    @model_validator(mode="after")
    def _is_unambiguous(self) -> GatewaySettings:
        incoming = [entry.topic for entry in self.inputs]
        streams = [entry.stream for entry in self.inputs]
        for what, names in (("topic", incoming), ("stream", streams)):
            if len(set(names)) != len(names):
                raise ValueError(f"inputs have a {what} twice: {', '.join(names)}")
        both = sorted({entry.topic for entry in self.outputs} & set(incoming))
        if both:
            raise ValueError(f"topic {both[0]} is input and output: its messages would circulate")
        if len(set(self.frames.values())) != len(self.frames):
            raise ValueError("frames: two names of the robot for one frame")
        return self


def load_settings(path: str | Path) -> GatewaySettings:
    """Read the settings of a gateway; raises ConfigurationError with file, key and expectation."""
    try:
        return GatewaySettings.model_validate(read_mapping(Path(path)))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "settings"
        raise ConfigurationError(f"{path}: {key}: {first['msg']}") from error

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to YARP."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, model_validator

from services.gateways.stream_settings import InputStream, OutputStream, RobotSettings

PortName = Annotated[str, Field(pattern=r"^(/[A-Za-z0-9_.:-]+)+$", max_length=255)]
Content = Literal["image", "imu", "pose", "cloud", "bitstream"]


class InputPort(InputStream):
    """An output port of the robot whose messages become samples.

    Attributes
    ----------
    port : str
    content : str
        ``image``; ``imu``, twelve numbers: orientation, acceleration, angular velocity (degrees), magnetic
        field; ``pose``, seven numbers x y z qx qy qz qw; ``cloud``, numbers x y z of each point; or
        ``bitstream``, a list of the name of an ASN.1 type and its bytes in unaligned PER.
    camera : tuple of float, optional
        Focal lengths and principal point ``fx fy cx cy`` of the images, pixels.
    without_stamp : "refuse" or "arrival"
        Treatment of messages without an envelope: they are dropped, or have the time of their arrival.
    """

    port: PortName
    content: Content
    camera: tuple[PositiveFloat, PositiveFloat, float, float] | None = None
    without_stamp: Literal["refuse", "arrival"] = "refuse"

    @model_validator(mode="after")
    def _has_frames_of_its_content(self) -> InputPort:
        if self.holds is not None:
            return self
        if (self.child is not None) != (self.content == "pose"):
            expected = "child frame" if self.content == "pose" else "no child frame"
            raise ValueError(f"content {self.content}: expected {expected}")
        if self.camera is not None and self.content != "image":
            raise ValueError(f"content {self.content}: expected no camera")
        return self


class OutputPort(OutputStream):
    """A product that is sent to an input port of the robot.

    Attributes
    ----------
    port : str
    content : str
        ``pose`` and ``image`` as for inputs; ``bitstream`` for any type.
    """

    port: PortName
    content: Literal["image", "pose", "bitstream"] = "bitstream"


class YarpSettings(RobotSettings):
    """Settings of the gateway to a robot with YARP. Nothing passes that is not listed.

    Attributes
    ----------
    node : str
        First part of the names of the ports of the gateway.
    inputs : list of InputPort
    outputs : list of OutputPort
        Empty: the gateway sends nothing to the robot.
    """

    node: PortName = "/cdff"
    inputs: tuple[InputPort, ...] = ()
    outputs: tuple[OutputPort, ...] = ()

    @model_validator(mode="after")
    def _is_unambiguous(self) -> YarpSettings:
        streams = [entry.stream for entry in self.inputs]
        pairs = [f"{entry.product} {entry.port}" for entry in self.outputs]
        for what, names in (("stream", streams), ("output", pairs)):
            if len(set(names)) != len(names):
                raise ValueError(f"a {what} occurs twice: {', '.join(names)}")
        return self

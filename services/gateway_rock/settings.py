# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to ROCK."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, model_validator

from services.gateways.stream_settings import InputStream, OutputStream, RobotSettings
from services.rock_types.conversions import CONVERSIONS, has_time

TaskName = Annotated[str, Field(pattern=r"^[A-Za-z0-9_/.:-]+$", max_length=255)]
PortName = Annotated[str, Field(pattern=r"^[A-Za-z_][A-Za-z0-9_]*$", max_length=255)]


class InputPort(InputStream):
    """An output port of a task whose samples become samples of a sensor.

    Attributes
    ----------
    task, port : str
    type : str
        Type of the samples in ROCK, such as ``/base/samples/LaserScan``.
    poll_hz : float
        Rate at which the port is asked for new samples.
    queue : int
        Samples that wait at the task; with more the oldest is dropped there.
    """

    task: TaskName
    port: PortName
    type: str
    poll_hz: PositiveFloat = 200.0
    queue: Annotated[int, Field(ge=1, le=10_000)] = 100

    @model_validator(mode="after")
    def _type_is_known(self) -> InputPort:
        known = sorted(filter(has_time, CONVERSIONS))
        if self.type not in known:
            raise ValueError(f"type {self.type!r}: expected one of {', '.join(known)}")
        return self


class OutputPort(OutputStream):
    """A product that is written to an input port of a task.

    Attributes
    ----------
    task, port : str
    type : str
        Type of the port in ROCK.
    type_of : str
        Output port ``TASK.PORT`` of the same type: the gateway takes the names of the type in the interface
        of the robot from its first sample.
    """

    task: TaskName
    port: PortName
    type: Literal["/base/samples/RigidBodyState", "/base/samples/Pointcloud"]
    type_of: Annotated[str, Field(pattern=r"^[A-Za-z0-9_/.:-]+\.[A-Za-z_][A-Za-z0-9_]*$")]


class RockSettings(RobotSettings):
    """Settings of the gateway to a robot with ROCK. Nothing passes that is not listed.

    Attributes
    ----------
    inputs : list of InputPort
    outputs : list of OutputPort
        Empty: the gateway writes nothing to the robot.
    """

    inputs: tuple[InputPort, ...] = ()
    outputs: tuple[OutputPort, ...] = ()

    @model_validator(mode="after")
    def _is_unambiguous(self) -> RockSettings:
        ports = [f"{entry.task}.{entry.port}" for entry in self.inputs]
        written = [f"{entry.task}.{entry.port}" for entry in self.outputs]
        streams = [entry.stream for entry in self.inputs]
        for what, names in (("input port", ports), ("output port", written), ("stream", streams)):
            if len(set(names)) != len(names):
                raise ValueError(f"a {what} occurs twice: {', '.join(names)}")
        return self

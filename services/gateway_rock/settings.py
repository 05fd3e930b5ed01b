# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway to ROCK."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, PositiveFloat, model_validator

from cdff_common.contract.products import requestable_products
from cdff_common.interfaces.dfn import StrictModel
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


class RequestTask(StrictModel):
    """A task of the gateway with the operation ``requestProduct``, by which the robot requests products.

    Attributes
    ----------
    task : str
        Name of the task in the name service.
    products : list of str
        Products that may be requested.
    deadline_s : float
        Longest time of a request.
    max_hz : float
        Largest rate, requests per second; others are refused.
    """

    task: TaskName = "cdff"
    products: Annotated[tuple[str, ...], Field(min_length=1)]
    deadline_s: Annotated[float, Field(gt=0.0, le=600.0)] = 20.0
    max_hz: PositiveFloat = 20.0

    @model_validator(mode="after")
    def _products_are_known(self) -> RequestTask:
        known = requestable_products()
        unknown = sorted(set(self.products) - set(known))
        if unknown:
            raise ValueError(f"product {unknown[0]!r}: expected some of {', '.join(known)}")
        return self


class RockSettings(RobotSettings):
    """Settings of the gateway to a robot with ROCK. Nothing passes that is not listed.

    Attributes
    ----------
    inputs : list of InputPort
    outputs : list of OutputPort
        Empty: the gateway writes nothing to the robot.
    requests : RequestTask or None
        None: the robot can request nothing.
    """

    inputs: tuple[InputPort, ...] = ()
    outputs: tuple[OutputPort, ...] = ()
    requests: RequestTask | None = None

    @model_validator(mode="after")
    def _is_unambiguous(self) -> RockSettings:
        ports = [f"{entry.task}.{entry.port}" for entry in self.inputs]
        written = [f"{entry.task}.{entry.port}" for entry in self.outputs]
        streams = [entry.stream for entry in self.inputs]
        for what, names in (("input port", ports), ("output port", written), ("stream", streams)):
            if len(set(names)) != len(names):
                raise ValueError(f"a {what} occurs twice: {', '.join(names)}")
        return self

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of all gateways: the robot with its frames, and the limits of what passes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import Field, PositiveFloat, ValidationError, model_validator

from cdff_common import types
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.profile import RobotId
from cdff_common.interfaces.sensor_profile import FrameId
from cdff_common.interfaces.yaml_file import read_mapping
from cdff_common.types.schema_table import MESSAGES

Pair = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*/[a-z][a-z0-9_]*$")]


class InputStream(StrictModel):
    """A source of the robot whose messages become samples, and the limits of these.

    Attributes
    ----------
    stream : str
        Sensor and stream on the bus, such as ``imu/sample``.
    frame, child : str
        Frame of the samples; for a pose the parent and the child frame.
    max_bytes : int
        Largest message, bytes; larger ones are dropped.
    max_hz : float
        Largest rate, messages per second, with bursts of at most as many as in 0.2 s; others are dropped.
    on_clock_fault : "refuse" or "report"
        Treatment of stamps that are not after the previous one, ahead of mission time or late: the sample is
        not sent, or it is sent with quality DEGRADED.
    codec : "uper" or "msgpack"
        Encoding of the samples; MessagePack takes less time for clouds and images.
    holds : str or None
        ASN.1 type in messages that are bitstreams: the samples are of this type. Without it they are the
        bitstreams.
    """

    stream: Pair
    frame: FrameId
    child: FrameId | None = None
    max_bytes: Annotated[int, Field(gt=0, le=1 << 30)] = 64 << 20
    max_hz: PositiveFloat = 1000.0
    on_clock_fault: Literal["refuse", "report"] = "refuse"
    codec: Literal["uper", "msgpack"] = "uper"
    holds: str | None = None

    @model_validator(mode="after")
    def _holds_a_type(self) -> InputStream:
        known = {name for name in MESSAGES if hasattr(types, name)}
        if self.holds is not None and self.holds not in known:
            raise ValueError(f"holds {self.holds!r}: expected an ASN.1 type such as LidarScan")
        return self


class OutputStream(StrictModel):
    """A product that becomes messages of the robot.

    Attributes
    ----------
    product : str
        DFPC and port, such as ``position_manager/pose``.
    max_hz : float
        Largest rate, messages per second; others are dropped.
    """

    product: Pair
    max_hz: PositiveFloat = 1000.0


class GatewayRobot(StrictModel):
    """Robot of a gateway.

    Attributes
    ----------
    robot : str
        Robot id.
    """

    robot: RobotId


class RobotSettings(GatewayRobot):
    """Robot of a gateway, and its frames.

    Attributes
    ----------
    frames : mapping of str to frame
        Frames of CDFF by their names of the robot. Without an entry ``lidar`` is ``{robot}/lidar``.
    """

    frames: dict[str, FrameId] = {}

    @model_validator(mode="after")
    def _has_one_name_for_a_frame(self) -> RobotSettings:
        if len(set(self.frames.values())) != len(self.frames):
            raise ValueError("frames: two names of the robot for one frame")
        return self


Settings = TypeVar("Settings", bound=GatewayRobot)


def load_settings(path: str | Path, model: type[Settings], robot: str | None = None) -> Settings:
    """Read the settings of a gateway.

    Parameters
    ----------
    robot : str, optional
        Robot that the settings must name.

    Raises
    ------
    ConfigurationError
        With file, key and expectation, if the settings are invalid or those of another robot.
    """
    try:
        settings = model.model_validate(read_mapping(Path(path)))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"])) or "settings"
        raise ConfigurationError(f"{path}: {key}: {first['msg']}") from error
    if robot not in (None, settings.robot):
        raise ConfigurationError(
            f"{path}: robot {settings.robot!r}, expected {robot!r}, whose profile names the file"
        )
    return settings

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Text of a new driver: a template with the names of a robot, a sensor, its frame and its stream."""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.resources import files

from cdff_common.contract.names import NAME, ROBOT_ID
from cdff_common.errors import InputError
from cdff_common.interfaces.profile import Profile

#: Type of the stream of each kind of driver: the modules of ``cdff_dev.new.drivers``.
STREAM_TYPES = {
    "lidar": "LidarScan",
    "stereo": "FramePair",
    "imu": "IMUSensors",
    "wheels": "TransformWithCovariance",
    "joints": "Joints",
    "gnss": "TransformWithCovariance",
}
#: Kind of the sensor in the profile, where the type of its stream does not determine it.
_SENSOR_KINDS = {"wheels": "wheels", "gnss": "other"}
_LICENCE = re.compile(r"\A(# SPDX[^\n]*\n)+")


@dataclass(frozen=True, slots=True)
class SensorNames:
    """Names that a driver uses; None keeps that of the template."""

    robot: str = "mana"
    sensor: str | None = None
    frame: str | None = None
    stream: str | None = None

    @classmethod
    def of_profile(
        cls, profile: Profile, kind: str, robot: str | None = None, sensor: str | None = None
    ) -> SensorNames:
        """Return the names of the sensor of a profile that has the stream of a kind of driver.

        Raises
        ------
        InputError
            If no sensor of the robot has such a stream, or several have and ``sensor`` names none of them.
        """
        if robot is None:
            robot = profile.robots[0].id
            if len(profile.robots) > 1:
                raise InputError(f"--robot: expected one of {', '.join(profile.robot_ids)}")
        frame_by_stream = {
            (name, stream): entry.frame
            for name, entry in profile.robot(robot).sensors.items()
            for stream, type_name in entry.streams.items()
            if type_name == STREAM_TYPES[kind] and entry.kind == _SENSOR_KINDS.get(kind, entry.kind)
        }
        chosen = [key for key in frame_by_stream if sensor in (None, key[0])]
        if len(chosen) != 1:
            names = ", ".join(f"{name}.{stream}" for name, stream in frame_by_stream) or "none"
            raise InputError(
                f"--sensor {sensor or '(not given)'}: expected one sensor of {robot} with a stream of type "
                f"{STREAM_TYPES[kind]} for a driver of kind {kind}; it has {names}"
            )
        name, stream = chosen[0]
        return cls(robot, name, frame_by_stream[chosen[0]], stream)


def driver_text(kind: str, names: SensorNames) -> str:
    """Return the source of a driver of a kind, with the names of a robot and its sensor.

    Raises
    ------
    InputError
        If a name is not valid in a profile.
    """
    for noun, name, pattern in (("robot", names.robot, ROBOT_ID), ("sensor", names.sensor, NAME)):
        if name is not None and not re.fullmatch(pattern, name):
            raise InputError(f"{noun} {name!r}: expected a name of a profile, a-z, 0-9 and _")
    text = files("cdff_dev.new.drivers").joinpath(f"{kind}.py").read_text(encoding="utf-8")
    text = _replace_once(r'^(ROBOT = )"\w+"', rf'\g<1>"{names.robot}"', _LICENCE.sub("", text))
    if names.sensor is not None:
        text = _replace_once(r'^(SENSOR = )"\w+"', rf'\g<1>"{names.sensor}"', text)
    if names.stream is not None:
        text = _replace_once(r'(Sensor\(f"\{SENSOR\}/)\w+"', rf'\g<1>{names.stream}"', text)
    if names.frame is not None:
        text = _replace_once(
            r'^(FRAME = |PARENT, CHILD = f"[^"]*", )f"[^"]*"', rf'\g<1>"{names.frame}"', text
        )
    return text


def _replace_once(pattern: str, replacement: str, text: str) -> str:
    """Return a template with the one place of a pattern replaced."""
    text, count = re.subn(pattern, replacement, text, count=1, flags=re.MULTILINE)
    assert count == 1, f"a template of a driver has no {pattern}"
    return text

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Questions about a robot for a new profile; an answer that is not usable is asked again."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import TypeVar

from cdff_common.contract.names import NAME
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.new.profile import CAMERA_AXES, RobotDraft, SensorDraft

Ask = Callable[[str], str]
_T = TypeVar("_T")

#: Kind of a sensor in a question -> kind in the profile, stream and type.
SENSOR_KINDS = {
    "lidar": ("lidar", "scan", "LidarScan"),
    "stereo": ("stereo_camera", "pair", "FramePair"),
    "camera": ("camera", "image", "Frame"),
    "imu": ("imu", "sample", "IMUSensors"),
    "wheels": ("wheels", "odometry", "TransformWithCovariance"),
    "joints": ("other", "joints", "Joints"),
    "gnss": ("other", "fix", "TransformWithCovariance"),
}
_LIMITS = (("max_slope_deg", 15.0), ("max_step_m", 0.15), ("max_roughness_m", 0.08))
_SIZES = (("width_m", 1.0), ("length_m", 1.2), ("height_m", 1.2))


def ask_robot(ask: Ask, show: Callable[[str], None]) -> tuple[RobotDraft, str]:
    """Return a robot and the body of its mission from answers.

    Parameters
    ----------
    ask : callable
        Shows a question and returns the answer, as ``input``.
    show : callable
        Shows the fault of an answer.
    """

    def checked(question: str, convert: Callable[[str], _T]) -> _T:
        while True:
            try:
                return convert(ask(question).strip())
            except InputError as error:
                show(str(error))

    robot = checked("Robot id [rover]: ", lambda text: _name(text or "rover"))
    body = checked("Body of the mission (moon, mars, earth, …) [moon]: ", lambda text: text or "moon")
    sensors: list[SensorDraft] = []
    show(f"Sensors: KIND NAME RATE_HZ, KIND one of {', '.join(SENSOR_KINDS)}; an empty line ends them.")
    while True:
        sensor = checked(f"Sensor {len(sensors) + 1}: ", lambda text: _sensor(text, robot, sensors))
        if sensor is None:
            break
        if sensor.frame != f"{robot}/base":
            question = "  mount in the base: x y z [m] roll pitch yaw [°], empty: later: "
            sensor = replace(
                sensor, mount=checked(question, partial(_mount, is_camera="camera" in sensor.kind))
            )
        sensors.append(sensor)
    limits = {
        name: checked(f"{name} [{default:g}]: ", partial(_positive, default=default))
        for name, default in (*_LIMITS, *_SIZES)
    }
    return RobotDraft(robot, sensors, limits), body


def _name(text: str) -> str:
    if not re.fullmatch(NAME, text):
        raise InputError(f"{text!r}: expected a name of a-z, 0-9 and _, which starts with a letter")
    return text


def _sensor(text: str, robot: str, known: list[SensorDraft]) -> SensorDraft | None:
    """Return a sensor of ``KIND NAME RATE_HZ``; None for an empty text."""
    if not text:
        return None
    words = text.split()
    if len(words) != 3 or words[0] not in SENSOR_KINDS:
        raise InputError(f"{text!r}: expected KIND NAME RATE_HZ, such as lidar front 10")
    name, rate_hz = _name(words[1]), _positive(words[2], 0.0)
    if name in {sensor.name for sensor in known}:
        raise InputError(f"{name!r}: another sensor has this name")
    kind, stream, type_name = SENSOR_KINDS[words[0]]
    on_base = words[0] in ("wheels", "joints")
    frame = (
        f"{robot}/base"
        if on_base
        else f"{robot}/{name}_left"
        if kind == "stereo_camera"
        else f"{robot}/{name}"
    )
    return SensorDraft(name, kind, frame, {stream: type_name}, rate_hz)


def _mount(text: str, is_camera: bool) -> FloatArray | None:
    """Return a mount; the angles of a camera turn one that looks ahead, about the axes of the base."""
    if not text:
        return None
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError as error:
        raise InputError(f"{text!r}: expected six numbers") from error
    if len(numbers) != 6:
        raise InputError(f"{text!r}: {len(numbers)} numbers, expected six")
    T = UncertainTransform.from_xyz_rpy_deg(numbers[:3], numbers[3:]).matrix
    return T @ CAMERA_AXES if is_camera else T


def _positive(text: str, default: float) -> float:
    try:
        value = float(text) if text else default
    except ValueError as error:
        raise InputError(f"{text!r}: expected a number") from error
    if not 0.0 < value < 1e6:
        raise InputError(f"{text!r}: expected a number above 0")
    return value

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of the types of ROCK (``base-types``) to CDFF types, by type name."""

from __future__ import annotations

from collections.abc import Callable, Collection
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.types import (
    Angle,
    AngleSegment,
    IMUSensors,
    JointLimitRange,
    JointLimits,
    Joints,
    JointState,
    JointsTrajectory,
    JointTrajectory,
    Matrix2d,
    Matrix3d,
    Matrix4d,
    Matrix6d,
    MatrixXd,
    Motion2D,
    Pose2D,
    Pressure,
    Quaterniond,
    RigidBodyAcceleration,
    Temperature,
    Time,
    Vector2d,
    Vector3d,
    Vector4d,
    Vector6d,
    VectorXd,
    Waypoint,
    Wrench,
    Wrenches,
)
from services.rock_types.images import IMAGES
from services.rock_types.poses import POSES
from services.rock_types.ranges import RANGES
from services.rock_types.values import (
    Conversion,
    Converted,
    Source,
    dynamic_matrix,
    matrix,
    microseconds,
    names_of,
    quaternion_xyzw,
    record,
    vector,
)


def _time(value: Any) -> Time:
    return Time(microseconds(value))


def _whole(cls: Any, how: Callable[[Any], Any], *fields: str) -> tuple[Conversion, ...]:
    """Return the conversion of a type of ROCK to a message ``cls`` with one field.

    The function ``how`` converts the whole value to this field, and uses the named ``fields`` of the value.
    """

    def convert(value: Any, source: Source) -> Converted:
        return cls(how(value)), source.sensor_frame, None

    return (Conversion(cls.ASN1_NAME, convert, fields),)


def _joint_state(value: Any) -> JointState:
    """Return the state of a joint; old versions have no acceleration."""
    names = names_of(value)
    columns = ("position", "speed", "effort", "raw", "acceleration")
    return JointState(*(float(value[name]) if name in names else np.nan for name in columns))


def _joint_states(values: Any) -> tuple[JointState, ...]:
    """Return the states of several joints."""
    return tuple(_joint_state(value) for value in values)


def _joint_range(value: Any) -> JointLimitRange:
    return JointLimitRange(_joint_state(value["min"]), _joint_state(value["max"]))


def _joints(elements: str) -> Conversion:
    return record(Joints, stamp="timestamp", names=("names", tuple), elements=(elements, _joint_states))


def _wrench(stamp: Time, value: Any) -> Wrench:
    return Wrench(stamp, vector(value["force"]), vector(value["torque"]))


def _wrenches(value: Any, source: Source) -> Converted:
    items = tuple(_wrench(source.time, item) for item in value["elements"])
    return Wrenches(timestamp=source.time, wrenches=items), source.sensor_frame, None


_WRENCH = record(Wrench, stamp="timestamp", force=("force", vector), torque=("torque", vector))
_MOTION = record(Motion2D, translation=("translation", float), rotation=("rotation", float))
_JOINT_STATE = Conversion(
    "JointState",
    lambda value, source: (_joint_state(value), source.sensor_frame, None),
    ("position", "speed", "effort", "raw"),
    ("acceleration",),
)

#: Conversions by type name; alternatives for versions of a type, of which the first that fits is used, have
#: equal suffixes.
CONVERSIONS: dict[str, tuple[Conversion, ...]] = {
    **POSES,
    **RANGES,
    **IMAGES,
    "/base/Time": _whole(Time, microseconds, "microseconds"),
    "/base/Angle": _whole(Angle, lambda value: float(value["rad"]), "rad"),
    "/base/AngleSegment": (
        record(AngleSegment, optional=("endRad",), start_rad=("startRad", float), width=("width", float)),
    ),
    "/base/Pose2D": (record(Pose2D, position=("position", vector), orientation=("orientation", float)),),
    "/base/Waypoint": (
        record(
            Waypoint,
            position=("position", vector),
            heading=("heading", float),
            tol_position=("tol_position", float),
            tol_heading=("tol_heading", float),
        ),
    ),
    "/base/commands/Motion2D": (_MOTION,),
    "/base/MotionCommand2D": (_MOTION,),
    "/base/samples/IMUSensors": (
        record(
            IMUSensors, stamp="timestamp", acc=("acc", vector), gyro=("gyro", vector), mag=("mag", vector)
        ),
    ),
    "/base/samples/RigidBodyAcceleration": (
        record(
            RigidBodyAcceleration,
            stamp="ref_time",
            acceleration=("acceleration", vector),
            cov_acceleration=("cov_acceleration", matrix),
        ),
    ),
    "/base/JointState": (_JOINT_STATE,),
    "/base/samples/Joints": (_joints("elements"), _joints("states")),
    "/base/commands/Joints": (_joints("elements"), _joints("states")),
    "/std/vector</base/JointState>": _whole(JointTrajectory, _joint_states),
    "/base/JointsTrajectory": (
        record(
            JointsTrajectory,
            vector_name=("names", tuple),
            timetags=("times", lambda times: tuple(_time(t) for t in times)),
            trajectory=("elements", lambda rows: tuple(_joint_states(row) for row in rows)),
        ),
    ),
    "/base/JointLimitRange": (record(JointLimitRange, min=("min", _joint_state), max=("max", _joint_state)),),
    "/base/JointLimits": (
        record(JointLimits, ranges=("elements", lambda rows: tuple(_joint_range(row) for row in rows))),
    ),
    "/base/Wrench": (_WRENCH,),
    "/base/samples/Wrench": (_WRENCH,),
    "/base/samples/Wrenches": (Conversion("Wrenches", _wrenches, ("elements",)),),
    "/base/Temperature": (record(Temperature, kelvin=("kelvin", float)),),
    "/base/samples/Temperature": (record(Temperature, kelvin=("kelvin", float)),),
    "/base/Pressure": (record(Pressure, stamp="timestamp", pascals=("pascal", float)),),
    "/base/samples/Pressure": (record(Pressure, stamp="timestamp", pascals=("pascal", float)),),
    "/wrappers/Matrix</double,2,1>": _whole(Vector2d, vector, "data"),
    "/wrappers/Matrix</double,3,1>": _whole(Vector3d, vector, "data"),
    "/wrappers/Matrix</double,4,1>": _whole(Vector4d, vector, "data"),
    "/wrappers/Matrix</double,6,1>": _whole(Vector6d, vector, "data"),
    "/wrappers/VectorX</double>": _whole(VectorXd, vector, "data"),
    "/wrappers/Matrix</double,2,2>": _whole(Matrix2d, matrix, "data"),
    "/wrappers/Matrix</double,3,3>": _whole(Matrix3d, matrix, "data"),
    "/wrappers/Matrix</double,4,4>": _whole(Matrix4d, matrix, "data"),
    "/wrappers/Matrix</double,6,6>": _whole(Matrix6d, matrix, "data"),
    "/wrappers/MatrixX</double>": (
        Conversion(
            "MatrixXd",
            lambda value, source: (MatrixXd(dynamic_matrix(value)), source.sensor_frame, None),
            ("rows", "cols", "data"),
        ),
    ),
    "/wrappers/Quaternion</double>": _whole(Quaterniond, quaternion_xyzw, "im", "re"),
}
#: Reasons why known types have no stream.
NO_CONVERSION = {
    "/base/Timeout": "no CDFF type has a duration of waiting",
    "/base/Trajectory": "no CDFF type has a spline",
    "/wrappers/geometry/Spline": "no CDFF type has a spline",
    "/base/samples/Sonar": "the CDFF type holds at most 60 values",
    "/base/samples/SonarBeam": "the CDFF type holds at most 60 values",
    "/base/samples/SonarScan": "the CDFF type holds at most 60 values",
}


def has_time(type_name: str) -> bool:
    """Return whether values of a type contain the time of their capture, as defined by the base-types."""
    return type_name.startswith("/base/samples/") or type_name == "/base/commands/Joints"


def conversion_of(type_name: str, names: Collection[str]) -> Conversion:
    """Return the first conversion of a type to which values with some fields fit.

    Raises
    ------
    InputError
        If there is none.
    """
    base = type_name.removesuffix("_m")
    known = CONVERSIONS.get(base)
    if known is None:
        reason = NO_CONVERSION.get(base, "no CDFF type has its content")
        raise InputError(f"type {type_name[:80]!r}: {reason}; expected one of {', '.join(CONVERSIONS)}")
    for conversion in known:
        if set(conversion.fields) <= set(names):
            return conversion
    missing = ", ".join(sorted(set(known[0].fields) - set(names)))
    raise InputError(f"value of the type {type_name}: without the fields {missing}")

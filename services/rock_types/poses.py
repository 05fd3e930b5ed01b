# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of poses, velocities and states of bodies.

ROCK states the pose of a source frame in a target frame: ``p_target = R p_source + t``. The covariance of the
orientation of a ``RigidBodyState`` is that of a rotation vector in the body, that is the source frame; of a
``TransformWithCovariance`` it is that of the coordinates of its rotation vector; CDFF's is in the parent
frame. NaN means unknown in all; ROCK also has infinite covariances of unknown values.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import (
    BodyState,
    Pose,
    RigidBodyState,
    TransformWithCovariance,
    TransformWithCovarianceData,
    TransformWithCovarianceMetadata,
    TwistWithCovariance,
    TwistWithCovarianceData,
    TwistWithCovarianceMetadata,
)
from services.rock_types.values import (
    Conversion,
    Converted,
    FloatArray,
    Source,
    matrix,
    names_of,
    quaternion_xyzw,
    vector,
)

#: Field of the orientation of a transform, which old versions of base-types call a rotation.
_ORIENTATIONS = ("orientation", "rotation")
#: Numbers of ``/base/samples/RigidBodyState``: field in CDFF, field in ROCK, and its conversion.
_STATE_NUMBERS = (
    ("pos", "position", vector),
    ("cov_position", "cov_position", matrix),
    ("orient", "orientation", quaternion_xyzw),
    ("cov_orientation", "cov_orientation", matrix),
    ("velocity", "velocity", vector),
    ("cov_velocity", "cov_velocity", matrix),
    ("angular_velocity", "angular_velocity", vector),
    ("cov_angular_velocity", "cov_angular_velocity", matrix),
)
_STATE_FIELDS = ("sourceFrame", "targetFrame", *(name for _, name, _ in _STATE_NUMBERS))


def _transform(
    translation: FloatArray, q_xyzw: FloatArray, cov: FloatArray, source: Source, parent: str, child: str
) -> TransformWithCovariance:
    """Return a pose between two frames with its covariance (6, 6)."""
    metadata = TransformWithCovarianceMetadata(
        producer_id=source.sensor_frame,
        data_estimated=np.ones(7, np.bool_),
        parent_frame_id=parent,
        parent_time=source.time,
        child_frame_id=child,
        child_time=source.time,
    )
    return TransformWithCovariance(metadata, TransformWithCovarianceData(translation, q_xyzw, cov))


def covariance_in_parent(
    cov_position: FloatArray, cov_rotation: FloatArray, q_xyzw: FloatArray
) -> FloatArray:
    """Return the 6x6 covariance of a pose, with NaN for unknown blocks.

    Parameters
    ----------
    cov_position, cov_rotation : array, shape (3, 3)
        In the target frame, and in the body.
    q_xyzw : array, shape (4,)
        Orientation of the body in the target frame.
    """
    cov = np.zeros((6, 6))
    cov[:3, :3] = cov_position if np.isfinite(cov_position).all() else np.nan
    norm = float(np.linalg.norm(q_xyzw))
    if np.isfinite(cov_rotation).all() and np.isfinite(norm) and norm > 0.0:
        R = se3.matrix_from_quaternion_xyzw(q_xyzw / norm)
        cov[3:, 3:] = R @ cov_rotation @ R.T
    else:
        cov[3:, 3:] = np.nan
    return cov


def _body_transform(value: Any, source: Source) -> Converted:
    """Return ``T_target_source`` with its covariance; the quaternion is that of the log."""
    parent, child = source.frame(value["targetFrame"]), source.frame(value["sourceFrame"])
    q_xyzw = quaternion_xyzw(value["orientation"])
    cov = covariance_in_parent(matrix(value["cov_position"]), matrix(value["cov_orientation"]), q_xyzw)
    message = _transform(vector(value["position"]), q_xyzw, cov, source, parent, child)
    return message, parent, child


def _body_state(value: Any, source: Source) -> Converted:
    """Return a ``RigidBodyState`` with all fields of the value, without a change of frame or unit."""
    parent, child = source.frame(value["targetFrame"]), source.frame(value["sourceFrame"])
    numbers: dict[str, Any] = {field: convert(value[name]) for field, name, convert in _STATE_NUMBERS}
    message = RigidBodyState(source.time, source_frame=child, target_frame=parent, **numbers)
    return message, parent, child


def _pose(value: Any, source: Source) -> Converted:
    message = Pose(vector(value["position"]), quaternion_xyzw(value["orientation"]))
    return message, source.sensor_frame, None


def _unnamed_transform(value: Any, source: Source) -> tuple[TransformWithCovariance, str, str]:
    """Return a transform whose frames have no names.

    Versions of base-types differ: the orientation is an angle with an axis and comes first, or it is a
    quaternion after the translation. The covariance has the order of the fields.
    """
    names = [name for name in names_of(value) if name in ("translation", *_ORIENTATIONS)]
    vector_rad, q_xyzw = _orientation(value[next(name for name in names if name in _ORIENTATIONS)])
    translation_first = names[0] == "translation"
    parent, child = source.frame("unnamed"), source.sensor_frame
    cov = covariance_of_vector(matrix(value["cov"]), vector_rad, translation_first=translation_first)
    return _transform(vector(value["translation"]), q_xyzw, cov, source, parent, child), parent, child


def _orientation(value: Any) -> tuple[FloatArray, FloatArray]:
    """Return an orientation as rotation vector ``(3,)`` and as quaternion ``(4,)``, x, y, z, w."""
    names = names_of(value)
    if "re" in names:
        q_xyzw = quaternion_xyzw(value)
        return se3.rotation_vector_from_quaternion_xyzw(q_xyzw), q_xyzw
    if not {"angle", "axis"} <= set(names):
        raise InputError(f"orientation of {', '.join(names)}: expected re and im, or angle and axis")
    angle_rad, axis = float(value["angle"]), np.asarray(value["axis"], np.float64)
    return angle_rad * axis, np.append(np.sin(angle_rad / 2.0) * axis, np.cos(angle_rad / 2.0))


def covariance_of_vector(cov: FloatArray, vector_rad: FloatArray, *, translation_first: bool) -> FloatArray:
    """Return the covariance of a pose in the parent frame; all NaN if an element is unknown.

    As in the composition of transforms in base-types, after Pennec and Thirion (1997),
    doi:10.1023/A:1007976002485, ``cov`` is that of translation and coordinates of the rotation vector ``r``:
    an error ``d`` of these is the rotation ``J_l(r) d`` in the parent frame, with the left Jacobian of SO(3).

    Parameters
    ----------
    cov : array, shape (6, 6)
    vector_rad : array, shape (3,)
        Rotation vector of the pose.
    translation_first : bool
        Order of ``cov``.
    """
    if not np.isfinite(cov).all() or not np.isfinite(vector_rad).all():
        return np.full((6, 6), np.nan)
    order = [0, 1, 2, 3, 4, 5] if translation_first else [3, 4, 5, 0, 1, 2]
    J = np.eye(6)
    J[3:, 3:] = se3.left_jacobian_so3(vector_rad)
    return np.asarray(J @ cov[np.ix_(order, order)] @ J.T)


def _twist(value: Any, source: Source) -> TwistWithCovariance:
    data = TwistWithCovarianceData(vector(value["vel"]), vector(value["rot"]), matrix(value["cov"]))
    return TwistWithCovariance(TwistWithCovarianceMetadata(1, source.time), data)


def _moving_body(value: Any, source: Source) -> Converted:
    pose, parent, child = _unnamed_transform(value["pose"], source)
    return BodyState(source.time, pose, _twist(value["velocity"], source)), parent, child


POSES = {
    "/base/Pose": (Conversion("Pose", _pose, ("position", "orientation")),),
    "/base/samples/RigidBodyState": (
        Conversion("TransformWithCovariance", _body_transform, _STATE_FIELDS),
        Conversion("RigidBodyState", _body_state, _STATE_FIELDS, suffix="_state"),
    ),
    "/base/TransformWithCovariance": tuple(
        Conversion("TransformWithCovariance", _unnamed_transform, ("translation", orientation, "cov"))
        for orientation in _ORIENTATIONS
    ),
    "/base/TwistWithCovariance": (
        Conversion(
            "TwistWithCovariance",
            lambda value, source: (_twist(value, source), source.sensor_frame, None),
            ("vel", "rot", "cov"),
        ),
    ),
    "/base/samples/BodyState": (Conversion("BodyState", _moving_body, ("pose", "velocity")),),
}

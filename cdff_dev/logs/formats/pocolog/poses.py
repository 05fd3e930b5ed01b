# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of poses, velocities and states of bodies.

ROCK states the pose of a source frame in a target frame: ``p_target = R p_source + t``. The covariance of its
orientation is that of a rotation vector in the body, that is the source frame; CDFF's is in the parent frame.
NaN means unknown in both; ROCK also has infinite covariances of unknown values.
"""

from __future__ import annotations

from typing import Any

import numpy as np

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
from cdff_dev.logs.formats.pocolog.values import (
    Conversion,
    Converted,
    FloatArray,
    Source,
    matrix,
    quaternion_xyzw,
    vector,
)

_NO_COVARIANCE = "versions of base-types differ in the order and meaning of its elements"
_STATE_FIELDS = (
    "sourceFrame",
    "targetFrame",
    "position",
    "cov_position",
    "orientation",
    "cov_orientation",
    "velocity",
    "cov_velocity",
    "angular_velocity",
    "cov_angular_velocity",
)


def _transform(
    translation: FloatArray, q_xyzw: FloatArray, cov: FloatArray, source: Source, parent: str, child: str
) -> TransformWithCovariance:
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
    message = RigidBodyState(
        timestamp=source.time,
        source_frame=child,
        target_frame=parent,
        pos=vector(value["position"]),
        cov_position=matrix(value["cov_position"]),
        orient=quaternion_xyzw(value["orientation"]),
        cov_orientation=matrix(value["cov_orientation"]),
        velocity=vector(value["velocity"]),
        cov_velocity=matrix(value["cov_velocity"]),
        angular_velocity=vector(value["angular_velocity"]),
        cov_angular_velocity=matrix(value["cov_angular_velocity"]),
    )
    return message, parent, child


def _pose(value: Any, source: Source) -> Converted:
    message = Pose(vector(value["position"]), quaternion_xyzw(value["orientation"]))
    return message, source.sensor_frame, None


def _unnamed_transform(value: Any, source: Source) -> tuple[TransformWithCovariance, str, str]:
    """Return a transform whose frames have no names, without covariance.

    Versions of base-types differ in the order and meaning of its elements, which the log does not state.
    """
    parent, child = source.frame("unnamed"), source.sensor_frame
    cov = np.full((6, 6), np.nan)
    q_xyzw = quaternion_xyzw(value["orientation"])
    return _transform(vector(value["translation"]), q_xyzw, cov, source, parent, child), parent, child


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
    "/base/TransformWithCovariance": (
        Conversion(
            "TransformWithCovariance",
            _unnamed_transform,
            ("translation", "orientation", "cov"),
            lost={"cov": _NO_COVARIANCE},
        ),
    ),
    "/base/TwistWithCovariance": (
        Conversion(
            "TwistWithCovariance",
            lambda value, source: (_twist(value, source), source.sensor_frame, None),
            ("vel", "rot", "cov"),
        ),
    ),
    "/base/samples/BodyState": (
        Conversion("BodyState", _moving_body, ("pose", "velocity"), lost={"pose.cov": _NO_COVARIANCE}),
    ),
}

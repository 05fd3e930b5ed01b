# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of ROCK for poses and clouds of CDFF, as dictionaries; ``poses`` and ``ranges`` read them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.types import LidarScan, Pointcloud, TransformWithCovariance

#: Returns the name of a frame in ROCK.
FrameName = Callable[[str], str]
_NS_PER_US = 1000
#: Type of the points of a cloud, ``/wrappers/Matrix</double,3,1>``.
_POINT = np.dtype([("data", np.float64, (3,))])


def _matrix(rows: Any) -> dict[str, Any]:
    """Return a matrix of Eigen, which stores its elements column by column."""
    return {"data": np.asarray(rows, np.float64).T.ravel()}


def rigid_body_state(value: TransformWithCovariance, frame: FrameName, stamp_ns: int) -> dict[str, Any]:
    """Return ``/base/samples/RigidBodyState`` of a pose, whose velocities are not known.

    ROCK has the covariance of the orientation in the body, and none between position and orientation.
    """
    q_xyzw, cov = value.data.orientation, np.asarray(value.data.cov, np.float64)
    R = se3.matrix_from_quaternion_xyzw(q_xyzw / np.linalg.norm(q_xyzw))
    unknown_matrix, unknown_vector = _matrix(np.full((3, 3), np.nan)), {"data": np.full(3, np.nan)}
    return {
        "time": {"microseconds": stamp_ns // _NS_PER_US},
        "sourceFrame": frame(value.child_frame),
        "targetFrame": frame(value.parent_frame),
        "position": {"data": np.asarray(value.data.translation, np.float64)},
        "cov_position": _matrix(cov[:3, :3]),
        "orientation": {"im": np.asarray(q_xyzw[:3], np.float64), "re": float(q_xyzw[3])},
        "cov_orientation": _matrix(R.T @ cov[3:, 3:] @ R),
        "velocity": unknown_vector,
        "cov_velocity": unknown_matrix,
        "angular_velocity": unknown_vector,
        "cov_angular_velocity": unknown_matrix,
    }


def point_cloud(value: LidarScan | Pointcloud, _: FrameName, stamp_ns: int) -> dict[str, Any]:
    """Return ``/base/samples/Pointcloud`` of a sweep or a cloud, without frame and times of points."""
    points = np.zeros(len(value.points_m), _POINT)
    points["data"] = value.points_m
    return {"time": {"microseconds": stamp_ns // _NS_PER_US}, "points": points, "colors": []}


_ENCODERS: dict[str, tuple[str, Callable[[Any, FrameName, int], dict[str, Any]]]] = {
    "TransformWithCovariance": ("/base/samples/RigidBodyState", rigid_body_state),
    "LidarScan": ("/base/samples/Pointcloud", point_cloud),
    "Pointcloud": ("/base/samples/Pointcloud", point_cloud),
}


def encoded(value: Any, type_name: str, frame: FrameName, stamp_ns: int) -> dict[str, Any]:
    """Return a value for a port of a type.

    Raises
    ------
    InputError
        If there is no conversion to this type.
    """
    name, encode = _ENCODERS.get(type(value).ASN1_NAME, ("", None))
    if encode is None or type_name.removesuffix("_m") != name:
        known = ", ".join(f"{cdff} as {rock}" for cdff, (rock, _) in _ENCODERS.items())
        raise InputError(f"a {type(value).ASN1_NAME} as {type_name[:80]}: expected {known}")
    return encode(value, frame, stamp_ns)

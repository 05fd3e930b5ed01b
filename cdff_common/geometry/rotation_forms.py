# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Rotations as roll, pitch and yaw in degrees and as quaternions of either order, and poses of ROS messages.

The order of a quaternion is always named: the first component of one order is the last of the other, and a
unit quaternion in the wrong order is still a unit quaternion.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray

#: Largest deviation of the norm of a quaternion from 1; within it, the quaternion is normalised.
QUATERNION_NORM_TOLERANCE = 0.01
#: Fields of ROS messages that contain a pose: of stamped messages, of those with a covariance, of odometry.
_NESTED = ("pose", "transform")
_PARTS = (("position", "orientation"), ("translation", "rotation"))


def matrix_from_rpy_deg(rpy_deg: ArrayLike) -> FloatArray:
    """Return the rotation matrix ``(3, 3)`` of roll, pitch and yaw about the fixed axes x, y, z, degrees.

    They are applied in this order, ``R = Rz(yaw) Ry(pitch) Rx(roll)``, as in URDF.
    """
    return matrix_from_rpy(np.deg2rad(_numbers(rpy_deg, 3, "rpy_deg")))


def matrix_from_rpy(rpy_rad: FloatArray) -> FloatArray:
    """Return the rotation matrix of roll, pitch and yaw as ``matrix_from_rpy_deg``, radians."""
    roll, pitch, yaw = rpy_rad
    return se3.exp_so3([0, 0, yaw]) @ se3.exp_so3([0, pitch, 0]) @ se3.exp_so3([roll, 0, 0])


def rpy_deg_from_matrix(R: ArrayLike) -> FloatArray:
    """Return roll, pitch and yaw ``(3,)``, degrees, of a rotation matrix; at a pitch of ±90° roll is 0."""
    r = np.asarray(R, dtype=np.float64)
    cosine = float(np.hypot(r[0, 0], r[1, 0]))
    pitch = np.arctan2(-r[2, 0], cosine)
    if cosine > 1e-9:
        roll, yaw = np.arctan2(r[2, 1], r[2, 2]), np.arctan2(r[1, 0], r[0, 0])
    else:
        roll, yaw = 0.0, np.arctan2(-r[0, 1], r[1, 1])
    angles_deg: FloatArray = np.rad2deg(np.array([roll, pitch, yaw]))
    return angles_deg


def matrix_from_quaternion(*, xyzw: ArrayLike | None = None, wxyz: ArrayLike | None = None) -> FloatArray:
    """Return the rotation matrix ``(3, 3)`` of a unit quaternion in one of the two orders.

    Raises
    ------
    InputError
        Unless exactly one quaternion is given, with a norm of 1 within ``QUATERNION_NORM_TOLERANCE``.
    """
    if (xyzw is None) == (wxyz is None):
        raise InputError(
            "quaternion: expected either xyzw= (ROS, Eigen, this framework) or wxyz= (scalar first)"
        )
    name = "quaternion xyzw" if wxyz is None else "quaternion wxyz"
    q = _numbers(xyzw if wxyz is None else wxyz, 4, name)
    norm = float(np.linalg.norm(q))
    if not abs(norm - 1.0) <= QUATERNION_NORM_TOLERANCE:
        raise InputError(f"{name} {q.tolist()}: its norm is {norm:.4g}, expected a unit quaternion")
    ordered = q if wxyz is None else q[[1, 2, 3, 0]]
    return se3.matrix_from_quaternion_xyzw(ordered / norm)


def isotropic_covariance(sigma_m: float, sigma_deg: float) -> FloatArray:
    """Return the covariance ``(6, 6)`` of equal standard deviations per axis: metres, and degrees."""
    if not (sigma_m >= 0 and sigma_deg >= 0):
        raise InputError(f"sigma_m={sigma_m}, sigma_deg={sigma_deg}: expected at least 0")
    return np.diag(np.square([sigma_m] * 3 + [float(np.deg2rad(sigma_deg))] * 3))


def parts_of_ros(message: Any) -> tuple[FloatArray, FloatArray, FloatArray | None]:
    """Return translation ``(3,)``, rotation ``(3, 3)`` and covariance ``(6, 6)`` or None of a ROS message.

    Parameters
    ----------
    message : object or mapping
        ``Pose``, ``Transform``, their stamped forms, ``PoseWithCovariance`` (``Stamped``) of geometry_msgs,
        or ``Odometry`` of nav_msgs: any object, or mapping, with the fields of one of these.

    Raises
    ------
    InputError
        If it has no such fields, or they are not those of a pose.

    Notes
    -----
    The covariance of ROS has the order x, y, z, rotation about x, y, z, and is stored by rows. One whose
    elements are all 0, or whose first element is negative, is unknown.
    """
    covariance: FloatArray | None = None
    while (
        inner := next((v for name in _NESTED if (v := _field(message, name)) is not None), None)
    ) is not None:
        values = _field(message, "covariance")
        if values is not None:
            c = _numbers(values, 36, "covariance of the ROS message").reshape(6, 6)
            covariance = c if c.any() and c[0, 0] >= 0 else None
        message = inner
    for position, orientation in _PARTS:
        t, q = _field(message, position), _field(message, orientation)
        if t is not None and q is not None:
            translation_m = _numbers([_field(t, axis) for axis in "xyz"], 3, position)
            R = matrix_from_quaternion(xyzw=[_field(q, axis) for axis in "xyzw"])
            return translation_m, R, covariance
    raise InputError(
        f"{type(message).__name__}: expected a ROS message with position and orientation, or translation and "
        "rotation"
    )


def _field(message: Any, name: str) -> Any:
    """Return a field of a message or mapping; None if it has none."""
    return message.get(name) if isinstance(message, Mapping) else getattr(message, name, None)


def _numbers(values: Any, count: int, name: str) -> FloatArray:
    """Return ``count`` finite numbers; raises InputError."""
    try:
        array = np.asarray(values, dtype=np.float64).reshape(-1)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: {values!r}, expected {count} numbers") from error
    if array.shape != (count,) or not np.isfinite(array).all():
        raise InputError(f"{name}: {array.tolist()}, expected {count} finite numbers")
    return array

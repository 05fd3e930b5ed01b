# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of poses: conversion from and to ``UncertainTransform``."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.rotation_forms import QUATERNION_NORM_TOLERANCE
from cdff_common.geometry.uncertain_transform import UncertainTransform
from cdff_common.types.message import Message


def matrix_of(
    translation_m: NDArray[np.float64], orientation_xyzw: NDArray[np.float64], where: str
) -> NDArray[np.float64]:
    """Return ``T (4, 4)`` of a translation and a quaternion x, y, z, w, normalised.

    Raises
    ------
    InputError
        If a number is not finite, or the quaternion is far from unit length.
    """
    norm = float(np.linalg.norm(orientation_xyzw))
    if not abs(norm - 1.0) <= QUATERNION_NORM_TOLERANCE or not np.isfinite(translation_m).all():
        raise InputError(
            f"{where}: translation {translation_m.tolist()}, quaternion {orientation_xyzw.tolist()}: "
            "expected finite numbers and a unit quaternion x y z w"
        )
    return se3.transform(se3.matrix_from_quaternion_xyzw(orientation_xyzw / norm), translation_m)


class PoseExt(Message):
    """Pose without frames."""

    __slots__ = ()
    pos: NDArray[np.float64]
    orient: NDArray[np.float64]

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.float64]) -> types.Pose:
        """Return the pose of a rigid transform ``(4, 4)``."""
        T = UncertainTransform(matrix).matrix
        return types.Pose(T[:3, 3].copy(), se3.quaternion_xyzw_from_matrix(T[:3, :3]))

    @classmethod
    def from_xyz_rpy_deg(cls, xyz_m: ArrayLike, rpy_deg: ArrayLike) -> types.Pose:
        """Return the pose of a position, metres, and roll, pitch, yaw about fixed axes, degrees."""
        return cls.from_matrix(UncertainTransform.from_xyz_rpy_deg(xyz_m, rpy_deg).matrix)

    @classmethod
    def from_quaternion(
        cls, xyz_m: ArrayLike, *, xyzw: ArrayLike | None = None, wxyz: ArrayLike | None = None
    ) -> types.Pose:
        """Return the pose of a position, metres, and a unit quaternion in one of the two orders."""
        return cls.from_matrix(UncertainTransform.from_quaternion(xyz_m, xyzw=xyzw, wxyz=wxyz).matrix)

    @classmethod
    def from_ros(cls, message: Any) -> types.Pose:
        """Return the pose of a ROS message, see ``geometry.rotation_forms.parts_of_ros``."""
        return cls.from_matrix(UncertainTransform.from_ros(message).matrix)

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Rigid transform ``(4, 4)``."""
        return matrix_of(self.pos, self.orient, "Pose")


class TransformWithCovarianceExt(Message):
    """Transform ``T_parent_child`` at a time, with its covariance if known."""

    __slots__ = ()
    metadata: types.TransformWithCovarianceMetadata
    data: types.TransformWithCovarianceData

    @classmethod
    def from_transform(
        cls, T: UncertainTransform, *, parent: str, child: str, stamp_ns: int, producer: str = ""
    ) -> types.TransformWithCovariance:
        """Return the message of ``T_parent_child`` at ``stamp_ns``; an unknown covariance is NaN."""
        time = types.Time.from_ns(stamp_ns)
        metadata = types.TransformWithCovarianceMetadata(
            producer_id=producer,
            data_estimated=np.ones(7, dtype=np.bool_),
            parent_frame_id=parent,
            parent_time=time,
            child_frame_id=child,
            child_time=time,
        )
        covariance = np.full((6, 6), np.nan) if T.covariance is None else T.covariance
        q_xyzw = se3.quaternion_xyzw_from_matrix(T.matrix[:3, :3])
        return types.TransformWithCovariance(
            metadata, types.TransformWithCovarianceData(T.matrix[:3, 3].copy(), q_xyzw, covariance)
        )

    @property
    def transform(self) -> UncertainTransform:
        """Transform ``T_parent_child``; its covariance is None if any element is NaN.

        Raises
        ------
        InputError
            If translation, quaternion or covariance are not those of a rigid transform.
        """
        T = matrix_of(self.data.translation, self.data.orientation, "TransformWithCovariance.data")
        unknown = bool(np.isnan(self.data.cov).any())
        return UncertainTransform(T, None if unknown else self.data.cov)

    @property
    def is_set(self) -> bool:
        """True if the transform has frames; without frames it is the neutral value of an unused field."""
        return bool(self.metadata.parent_frame_id or self.metadata.child_frame_id)

    @property
    def stamp_ns(self) -> int:
        """Time of the child, nanoseconds."""
        return self.metadata.child_time.ns


class RigidBodyStateExt(Message):
    """State of ``source_frame`` in ``target_frame``."""

    __slots__ = ()
    timestamp: types.Time
    source_frame: str
    target_frame: str
    pos: NDArray[np.float64]
    orient: NDArray[np.float64]
    cov_position: NDArray[np.float64]
    cov_orientation: NDArray[np.float64]

    @classmethod
    def from_transform(
        cls, T: UncertainTransform, *, parent: str, child: str, stamp_ns: int
    ) -> types.RigidBodyState:
        """Return the state of ``T_parent_child`` without cross-covariance and with NaN velocities."""
        cov = np.full((6, 6), np.nan) if T.covariance is None else T.covariance
        return types.RigidBodyState(
            timestamp=types.Time.from_ns(stamp_ns),
            source_frame=child,
            target_frame=parent,
            pos=T.matrix[:3, 3].copy(),
            cov_position=cov[:3, :3],
            orient=se3.quaternion_xyzw_from_matrix(T.matrix[:3, :3]),
            cov_orientation=cov[3:, 3:],
            velocity=np.full(3, np.nan),
            angular_velocity=np.full(3, np.nan),
        )

    @property
    def transform(self) -> UncertainTransform:
        """Transform ``T_target_source``; its covariance is None if any element is NaN."""
        T = matrix_of(self.pos, self.orient, "RigidBodyState")
        cov = np.zeros((6, 6))
        cov[:3, :3], cov[3:, 3:] = self.cov_position, self.cov_orientation
        return UncertainTransform(T, None if np.isnan(cov).any() else cov)

    @property
    def parent_frame(self) -> str:
        """Parent frame: the target."""
        return self.target_frame

    @property
    def child_frame(self) -> str:
        """Child frame: the source."""
        return self.source_frame

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of poses: from and to the one transform with covariance of ``cdff_common.geometry``."""

from __future__ import annotations

from collections.abc import Iterable
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.uncertain import UncertainTransform
from cdff_common.types.message import Box, Message
from cdff_common.types.time import Time

if TYPE_CHECKING:
    from cdff_common.types.pose import (
        Pose,
        RigidBodyState,
        TransformWithCovariance,
        TransformWithCovarianceData,
        TransformWithCovarianceMetadata,
    )

#: How far from 1 the norm of a quaternion on the wire may be; within, it is normalised.
QUATERNION_NORM_TOLERANCE = 0.01


def matrix_of(
    translation_m: NDArray[np.float64], orientation_xyzw: NDArray[np.float64], where: str
) -> NDArray[np.float64]:
    """``T (4, 4)`` of a translation and a quaternion x, y, z, w, normalised.

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


def _box_of_point(p: NDArray[np.float64]) -> Box | None:
    if not np.isfinite(p).all():
        return None
    x, y, z = (float(v) for v in p)
    return (x, y, z, x, y, z)


class PoseExt(Message):
    """A pose without frames."""

    __slots__ = ()
    if TYPE_CHECKING:
        pos: NDArray[np.float64]
        orient: NDArray[np.float64]

    @classmethod
    def from_matrix(cls, matrix: NDArray[np.float64]) -> Pose:
        """Pose of a rigid transform ``(4, 4)``."""
        from cdff_common.types.pose import Pose

        T = UncertainTransform(matrix).matrix
        return Pose(T[:3, 3].copy(), se3.quaternion_xyzw_from_matrix(T[:3, :3]))

    @property
    def matrix(self) -> NDArray[np.float64]:
        """Rigid transform ``(4, 4)``."""
        return matrix_of(self.pos, self.orient, "Pose")

    def extent_m(self) -> Box | None:
        """The position as a box without size."""
        return _box_of_point(self.pos)


def box_of_boxes(boxes: Iterable[Box | None]) -> Box | None:
    """Box around boxes; None where there is none."""
    known = [b for b in boxes if b is not None]
    if not known:
        return None
    low, high = [min(b[i] for b in known) for i in range(3)], [max(b[i] for b in known) for i in range(3, 6)]
    return (low[0], low[1], low[2], high[0], high[1], high[2])


class WaypointExt(Message):
    """Where to go."""

    __slots__ = ()
    if TYPE_CHECKING:
        position: NDArray[np.float64]

    def extent_m(self) -> Box | None:
        """The position as a box without size."""
        return _box_of_point(self.position)


class TrajectoryExt(Message):
    """A line to follow."""

    __slots__ = ()
    if TYPE_CHECKING:
        points: NDArray[np.float64]

    def extent_m(self) -> Box | None:
        """Box around the points."""
        return box_of_boxes(_box_of_point(p) for p in self.points)


class PathExt(Message):
    """Poses to pass."""

    __slots__ = ()
    if TYPE_CHECKING:
        time_stamp: Time
        waypoints: tuple[TransformWithCovariance, ...]

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns

    def extent_m(self) -> Box | None:
        """Box around the positions."""
        return box_of_boxes(w.extent_m() for w in self.waypoints)


class BodyStateExt(Message):
    """Pose and velocity."""

    __slots__ = ()
    if TYPE_CHECKING:
        ref_time: Time
        pose: TransformWithCovariance

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns

    def extent_m(self) -> Box | None:
        """The position as a box without size."""
        return self.pose.extent_m()


class TransformWithCovarianceExt(Message):
    """``T_parent_child`` at a time, with the covariance where it is known."""

    __slots__ = ()
    if TYPE_CHECKING:
        metadata: TransformWithCovarianceMetadata
        data: TransformWithCovarianceData

    @classmethod
    def from_transform(
        cls, T: UncertainTransform, *, parent: str, child: str, stamp_ns: int, producer: str = ""
    ) -> TransformWithCovariance:
        """Message of ``T_parent_child`` at ``stamp_ns``; an unknown covariance travels as NaN."""
        from cdff_common.types.pose import (
            TransformWithCovariance,
            TransformWithCovarianceData,
            TransformWithCovarianceMetadata,
        )

        time = Time.from_ns(stamp_ns)
        metadata = TransformWithCovarianceMetadata(
            producer_id=producer,
            data_estimated=np.ones(7, dtype=np.bool_),
            parent_frame_id=parent,
            parent_time=time,
            child_frame_id=child,
            child_time=time,
        )
        covariance = np.full((6, 6), np.nan) if T.covariance is None else T.covariance
        q_xyzw = se3.quaternion_xyzw_from_matrix(T.matrix[:3, :3])
        return TransformWithCovariance(
            metadata, TransformWithCovarianceData(T.matrix[:3, 3].copy(), q_xyzw, covariance)
        )

    @property
    def transform(self) -> UncertainTransform:
        """``T_parent_child``; its covariance is None where any of it is NaN.

        Raises
        ------
        InputError
            If translation, quaternion or covariance are not those of a rigid transform.
        """
        T = matrix_of(self.data.translation, self.data.orientation, "TransformWithCovariance.data")
        unknown = bool(np.isnan(self.data.cov).any())
        return UncertainTransform(T, None if unknown else self.data.cov)

    @property
    def parent_frame(self) -> str:
        """The frame in which."""
        return self.metadata.parent_frame_id

    @property
    def child_frame(self) -> str:
        """The frame of which."""
        return self.metadata.child_frame_id

    @property
    def is_set(self) -> bool:
        """Whether it states a transform: a transform without frames is the neutral filling of an unused field."""
        return bool(self.metadata.parent_frame_id or self.metadata.child_frame_id)

    @property
    def stamp_ns(self) -> int:
        """Time of the child, nanoseconds."""
        return self.metadata.child_time.ns

    def extent_m(self) -> Box | None:
        """The child's origin in the parent as a box without size."""
        return _box_of_point(self.data.translation)


class RigidBodyStateExt(Message):
    """State of ``source_frame`` in ``target_frame``."""

    __slots__ = ()
    if TYPE_CHECKING:
        timestamp: Time
        source_frame: str
        target_frame: str
        pos: NDArray[np.float64]
        orient: NDArray[np.float64]
        cov_position: NDArray[np.float64]
        cov_orientation: NDArray[np.float64]

    @classmethod
    def from_transform(cls, T: UncertainTransform, *, parent: str, child: str, stamp_ns: int) -> RigidBodyState:
        """State of ``T_parent_child``; cross-covariance of position and orientation is dropped, velocities are NaN."""
        from cdff_common.types.pose import RigidBodyState

        cov = np.full((6, 6), np.nan) if T.covariance is None else T.covariance
        return RigidBodyState(
            timestamp=Time.from_ns(stamp_ns),
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
        """``T_target_source``; its covariance is None where any of position's or orientation's is NaN."""
        T = matrix_of(self.pos, self.orient, "RigidBodyState")
        cov = np.zeros((6, 6))
        cov[:3, :3], cov[3:, 3:] = self.cov_position, self.cov_orientation
        return UncertainTransform(T, None if np.isnan(cov).any() else cov)

    @property
    def parent_frame(self) -> str:
        """The frame in which: the target."""
        return self.target_frame

    @property
    def child_frame(self) -> str:
        """The frame of which: the source."""
        return self.source_frame

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns

    def extent_m(self) -> Box | None:
        """The position as a box without size."""
        return _box_of_point(self.pos)

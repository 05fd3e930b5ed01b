# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pose.asn by cdff generate; do not edit.

"""Types of ``asn1/pose.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message, PoseMessage
from cdff_common.types.pose_ext import PoseExt, RigidBodyStateExt, TransformWithCovarianceExt
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TransformWithCovarianceMetadata(Message):
    """Type ``TransformWithCovariance-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
        process that estimated it.
    data_estimated : NDArray[np.bool_], shape (7,)
        true for those of x y z qx qy qz qw that are estimates.
    parent_frame_id : str, at most 256 bytes
        frame a of T_a_b.
    parent_time : Time
    child_frame_id : str, at most 256 bytes
        frame b of T_a_b.
    child_time : Time
    """

    ASN1_NAME: ClassVar[str] = "TransformWithCovariance-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    data_estimated: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((7,), np.bool_))
    parent_frame_id: str = ""
    parent_time: Time = field(default_factory=Time)
    child_frame_id: str = ""
    child_time: Time = field(default_factory=Time)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TransformWithCovarianceData(Message):
    """Type ``TransformWithCovariance-Data`` of the ASN.1 modules.

    Attributes
    ----------
    translation : NDArray[np.float64], shape (3,)
        m, of the child's origin in the parent.
    orientation : NDArray[np.float64], shape (4,)
        x y z w, child to parent.
    cov : NDArray[np.float64], shape (6, 6)
        6x6, x y z rx ry rz, in the parent; NaN where unknown.
    """

    ASN1_NAME: ClassVar[str] = "TransformWithCovariance-Data"
    translation: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    orientation: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    cov: NDArray[np.float64] = field(default_factory=lambda: np.full((6, 6), np.nan))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TransformWithCovariance(TransformWithCovarianceExt, PoseMessage):
    """T_parent_child: maps coordinates in the child frame into the parent frame. With equal frames and
    two times it is the motion between these times.

    Attributes
    ----------
    metadata : TransformWithCovarianceMetadata
    data : TransformWithCovarianceData
    """

    ASN1_NAME: ClassVar[str] = "TransformWithCovariance"
    metadata: TransformWithCovarianceMetadata = field(default_factory=TransformWithCovarianceMetadata)
    data: TransformWithCovarianceData = field(default_factory=TransformWithCovarianceData)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pose(PoseExt):
    """Position and orientation without frames.

    Attributes
    ----------
    pos : NDArray[np.float64], shape (3,)
        m.
    orient : NDArray[np.float64], shape (4,)
        unit quaternion x y z w.
    """

    ASN1_NAME: ClassVar[str] = "Pose"
    pos: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    orient: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Position(Message):
    """Type ``Position`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (3,)
    """

    ASN1_NAME: ClassVar[str] = "Position"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Position2D(Message):
    """Type ``Position2D`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (2,)
    """

    ASN1_NAME: ClassVar[str] = "Position2D"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Orientation(Message):
    """Type ``Orientation`` of the ASN.1 modules.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4,)
    """

    ASN1_NAME: ClassVar[str] = "Orientation"
    values: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseUpdateThreshold(Message):
    """Type ``PoseUpdateThreshold`` of the ASN.1 modules.

    Attributes
    ----------
    distance : float
        m.
    angle : float
        rad.
    """

    ASN1_NAME: ClassVar[str] = "PoseUpdateThreshold"
    distance: float = 0.0
    angle: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pose2D(Message):
    """Type ``Pose2D`` of the ASN.1 modules.

    Attributes
    ----------
    position : NDArray[np.float64], shape (2,)
        m.
    orientation : float
        rad.
    """

    ASN1_NAME: ClassVar[str] = "Pose2D"
    position: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))
    orientation: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Motion2D(Message):
    """Type ``Motion2D`` of the ASN.1 modules.

    Attributes
    ----------
    translation : float
        m/s.
    rotation : float
        rad/s.
    """

    ASN1_NAME: ClassVar[str] = "Motion2D"
    translation: float = 0.0
    rotation: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TwistWithCovarianceMetadata(Message):
    """Type ``TwistWithCovariance-metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    """

    ASN1_NAME: ClassVar[str] = "TwistWithCovariance-metadata"
    msg_version: int = 0
    time_stamp: Time = field(default_factory=Time)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TwistWithCovarianceData(Message):
    """Type ``TwistWithCovariance-data`` of the ASN.1 modules.

    Attributes
    ----------
    vel : NDArray[np.float64], shape (3,)
        m/s.
    rot : NDArray[np.float64], shape (3,)
        rad/s.
    cov : NDArray[np.float64], shape (6, 6)
        6x6, vx vy vz wx wy wz.
    """

    ASN1_NAME: ClassVar[str] = "TwistWithCovariance-data"
    vel: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    rot: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    cov: NDArray[np.float64] = field(default_factory=lambda: np.full((6, 6), np.nan))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TwistWithCovariance(Message):
    """Linear and angular velocity.

    Attributes
    ----------
    metadata : TwistWithCovarianceMetadata
    data : TwistWithCovarianceData
    """

    ASN1_NAME: ClassVar[str] = "TwistWithCovariance"
    metadata: TwistWithCovarianceMetadata = field(default_factory=TwistWithCovarianceMetadata)
    data: TwistWithCovarianceData = field(default_factory=TwistWithCovarianceData)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BodyState(Message):
    """Pose and velocity of a body.

    Attributes
    ----------
    ref_time : Time
    pose : TransformWithCovariance
    velocity : TwistWithCovariance
    """

    ASN1_NAME: ClassVar[str] = "BodyState"
    ref_time: Time = field(default_factory=Time)
    pose: TransformWithCovariance = field(default_factory=TransformWithCovariance)
    velocity: TwistWithCovariance = field(default_factory=TwistWithCovariance)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigidBodyState(RigidBodyStateExt):
    """State of sourceFrame in targetFrame. NaN where unknown.

    Attributes
    ----------
    timestamp : Time
    source_frame : str, at most 256 bytes
    target_frame : str, at most 256 bytes
    pos : NDArray[np.float64], shape (3,)
        m, origin of the source in the target.
    cov_position : NDArray[np.float64], shape (3, 3)
        m2.
    orient : NDArray[np.float64], shape (4,)
        x y z w, source to target.
    cov_orientation : NDArray[np.float64], shape (3, 3)
        rad2.
    velocity : NDArray[np.float64], shape (3,)
        m/s, in the target.
    cov_velocity : NDArray[np.float64], shape (3, 3)
        m2/s2.
    angular_velocity : NDArray[np.float64], shape (3,)
        rad/s.
    cov_angular_velocity : NDArray[np.float64], shape (3, 3)
        rad2/s2.
    """

    ASN1_NAME: ClassVar[str] = "RigidBodyState"
    timestamp: Time = field(default_factory=Time)
    source_frame: str = ""
    target_frame: str = ""
    pos: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    cov_position: NDArray[np.float64] = field(default_factory=lambda: np.full((3, 3), np.nan))
    orient: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))
    cov_orientation: NDArray[np.float64] = field(default_factory=lambda: np.full((3, 3), np.nan))
    velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    cov_velocity: NDArray[np.float64] = field(default_factory=lambda: np.full((3, 3), np.nan))
    angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    cov_angular_velocity: NDArray[np.float64] = field(default_factory=lambda: np.full((3, 3), np.nan))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.timestamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigidBodyAcceleration(Message):
    """Acceleration of a body.

    Attributes
    ----------
    ref_time : Time
    acceleration : NDArray[np.float64], shape (3,)
        m/s2.
    cov_acceleration : NDArray[np.float64], shape (3, 3)
        m2/s4.
    """

    ASN1_NAME: ClassVar[str] = "RigidBodyAcceleration"
    ref_time: Time = field(default_factory=Time)
    acceleration: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    cov_acceleration: NDArray[np.float64] = field(default_factory=lambda: np.full((3, 3), np.nan))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Waypoint(Message):
    """Target position and heading with tolerances.

    Attributes
    ----------
    position : NDArray[np.float64], shape (3,)
        m.
    heading : float
        rad.
    tol_position : float
        m.
    tol_heading : float
        rad.
    """

    ASN1_NAME: ClassVar[str] = "Waypoint"
    position: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    heading: float = 0.0
    tol_position: float = 0.0
    tol_heading: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory(Message):
    """Path to follow at a speed.

    Attributes
    ----------
    speed : float
        m/s.
    points : NDArray[np.float64], shape (1..1048576, 3)
        m.
    """

    ASN1_NAME: ClassVar[str] = "Trajectory"
    speed: float = 0.0
    points: NDArray[np.float64] = field(default_factory=lambda: np.zeros((1, 3), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Path(Message):
    """Sequence of waypoints.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    waypoints : tuple[TransformWithCovariance, ...]
    """

    ASN1_NAME: ClassVar[str] = "Path"
    msg_version: int = 0
    time_stamp: Time = field(default_factory=Time)
    waypoints: tuple[TransformWithCovariance, ...] = ()

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns

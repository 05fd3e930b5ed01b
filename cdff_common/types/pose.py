# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pose.asn by cdff generate; do not edit.

"""Types of ``asn1/pose.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.pose_ext import (
    BodyStateExt,
    PathExt,
    PoseExt,
    RigidBodyStateExt,
    TrajectoryExt,
    TransformWithCovarianceExt,
    WaypointExt,
)
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TransformWithCovarianceMetadata(Message):
    """What a ``TransformWithCovariance-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
        who estimated it.
    data_estimated : NDArray[np.bool_], shape (7,)
        which of x y z qx qy qz qw are estimates.
    parent_frame_id : str, at most 256 octets
        the frame in which.
    parent_time : Time
    child_frame_id : str, at most 256 octets
        the frame of which.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "msg_version",
            check.integer(self.msg_version, "TransformWithCovarianceMetadata.msg_version", 0, 4294967295),
        )
        put(self, "producer_id", check.text(self.producer_id, "TransformWithCovarianceMetadata.producer_id", 256))
        put(
            self,
            "data_estimated",
            check.boolean_array(self.data_estimated, "TransformWithCovarianceMetadata.data_estimated", ((7, 7),)),
        )
        put(
            self,
            "parent_frame_id",
            check.text(self.parent_frame_id, "TransformWithCovarianceMetadata.parent_frame_id", 256),
        )
        put(self, "parent_time", check.instance(self.parent_time, "TransformWithCovarianceMetadata.parent_time", Time))
        put(
            self,
            "child_frame_id",
            check.text(self.child_frame_id, "TransformWithCovarianceMetadata.child_frame_id", 256),
        )
        put(self, "child_time", check.instance(self.child_time, "TransformWithCovarianceMetadata.child_time", Time))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TransformWithCovarianceData(Message):
    """What a ``TransformWithCovariance-Data`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "translation",
            check.real_array(self.translation, "TransformWithCovarianceData.translation", ((3, 3),)),
        )
        put(
            self,
            "orientation",
            check.real_array(self.orientation, "TransformWithCovarianceData.orientation", ((4, 4),)),
        )
        put(self, "cov", check.real_array(self.cov, "TransformWithCovarianceData.cov", ((6, 6), (6, 6))))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TransformWithCovariance(TransformWithCovarianceExt):
    """T_parent_child: maps coordinates in the child frame into the parent frame. With equal frames and two times it
    is the motion between them.

    Attributes
    ----------
    metadata : TransformWithCovarianceMetadata
    data : TransformWithCovarianceData
    """

    ASN1_NAME: ClassVar[str] = "TransformWithCovariance"
    metadata: TransformWithCovarianceMetadata = field(default_factory=TransformWithCovarianceMetadata)
    data: TransformWithCovarianceData = field(default_factory=TransformWithCovarianceData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "metadata",
            check.instance(self.metadata, "TransformWithCovariance.metadata", TransformWithCovarianceMetadata),
        )
        put(self, "data", check.instance(self.data, "TransformWithCovariance.data", TransformWithCovarianceData))
        self._check_together()


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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "pos", check.real_array(self.pos, "Pose.pos", ((3, 3),)))
        put(self, "orient", check.real_array(self.orient, "Pose.orient", ((4, 4),)))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Position(Message):
    """What a ``Position`` of the ASN.1 modules holds.

    Attributes
    ----------
    values : NDArray[np.float64], shape (3,)
    """

    ASN1_NAME: ClassVar[str] = "Position"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "values", check.real_array(self.values, "Position.values", ((3, 3),)))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Position2D(Message):
    """What a ``Position2D`` of the ASN.1 modules holds.

    Attributes
    ----------
    values : NDArray[np.float64], shape (2,)
    """

    ASN1_NAME: ClassVar[str] = "Position2D"
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros((2,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "values", check.real_array(self.values, "Position2D.values", ((2, 2),)))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Orientation(Message):
    """What an ``Orientation`` of the ASN.1 modules holds.

    Attributes
    ----------
    values : NDArray[np.float64], shape (4,)
    """

    ASN1_NAME: ClassVar[str] = "Orientation"
    values: NDArray[np.float64] = field(default_factory=lambda: np.array([0.0, 0.0, 0.0, 1.0]))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "values", check.real_array(self.values, "Orientation.values", ((4, 4),)))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseUpdateThreshold(Message):
    """What a ``PoseUpdateThreshold`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "distance", check.real(self.distance, "PoseUpdateThreshold.distance"))
        put(self, "angle", check.real(self.angle, "PoseUpdateThreshold.angle"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pose2D(Message):
    """What a ``Pose2D`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "position", check.real_array(self.position, "Pose2D.position", ((2, 2),)))
        put(self, "orientation", check.real(self.orientation, "Pose2D.orientation"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Motion2D(Message):
    """What a ``Motion2D`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "translation", check.real(self.translation, "Motion2D.translation"))
        put(self, "rotation", check.real(self.rotation, "Motion2D.rotation"))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TwistWithCovarianceMetadata(Message):
    """What a ``TwistWithCovariance-metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
    """

    ASN1_NAME: ClassVar[str] = "TwistWithCovariance-metadata"
    msg_version: int = 0
    time_stamp: Time = field(default_factory=Time)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "msg_version",
            check.integer(self.msg_version, "TwistWithCovarianceMetadata.msg_version", 0, 4294967295),
        )
        put(self, "time_stamp", check.instance(self.time_stamp, "TwistWithCovarianceMetadata.time_stamp", Time))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TwistWithCovarianceData(Message):
    """What a ``TwistWithCovariance-data`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "vel", check.real_array(self.vel, "TwistWithCovarianceData.vel", ((3, 3),)))
        put(self, "rot", check.real_array(self.rot, "TwistWithCovarianceData.rot", ((3, 3),)))
        put(self, "cov", check.real_array(self.cov, "TwistWithCovarianceData.cov", ((6, 6), (6, 6))))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class TwistWithCovariance(Message):
    """Velocity, linear and angular.

    Attributes
    ----------
    metadata : TwistWithCovarianceMetadata
    data : TwistWithCovarianceData
    """

    ASN1_NAME: ClassVar[str] = "TwistWithCovariance"
    metadata: TwistWithCovarianceMetadata = field(default_factory=TwistWithCovarianceMetadata)
    data: TwistWithCovarianceData = field(default_factory=TwistWithCovarianceData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self, "metadata", check.instance(self.metadata, "TwistWithCovariance.metadata", TwistWithCovarianceMetadata)
        )
        put(self, "data", check.instance(self.data, "TwistWithCovariance.data", TwistWithCovarianceData))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class BodyState(BodyStateExt):
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "BodyState.ref_time", Time))
        put(self, "pose", check.instance(self.pose, "BodyState.pose", TransformWithCovariance))
        put(self, "velocity", check.instance(self.velocity, "BodyState.velocity", TwistWithCovariance))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class RigidBodyState(RigidBodyStateExt):
    """State of sourceFrame in targetFrame. NaN where unknown.

    Attributes
    ----------
    timestamp : Time
    source_frame : str, at most 256 octets
    target_frame : str, at most 256 octets
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "timestamp", check.instance(self.timestamp, "RigidBodyState.timestamp", Time))
        put(self, "source_frame", check.text(self.source_frame, "RigidBodyState.source_frame", 256))
        put(self, "target_frame", check.text(self.target_frame, "RigidBodyState.target_frame", 256))
        put(self, "pos", check.real_array(self.pos, "RigidBodyState.pos", ((3, 3),)))
        put(self, "cov_position", check.real_array(self.cov_position, "RigidBodyState.cov_position", ((3, 3), (3, 3))))
        put(self, "orient", check.real_array(self.orient, "RigidBodyState.orient", ((4, 4),)))
        put(
            self,
            "cov_orientation",
            check.real_array(self.cov_orientation, "RigidBodyState.cov_orientation", ((3, 3), (3, 3))),
        )
        put(self, "velocity", check.real_array(self.velocity, "RigidBodyState.velocity", ((3, 3),)))
        put(self, "cov_velocity", check.real_array(self.cov_velocity, "RigidBodyState.cov_velocity", ((3, 3), (3, 3))))
        put(
            self,
            "angular_velocity",
            check.real_array(self.angular_velocity, "RigidBodyState.angular_velocity", ((3, 3),)),
        )
        put(
            self,
            "cov_angular_velocity",
            check.real_array(self.cov_angular_velocity, "RigidBodyState.cov_angular_velocity", ((3, 3), (3, 3))),
        )
        self._check_together()


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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ref_time", check.instance(self.ref_time, "RigidBodyAcceleration.ref_time", Time))
        put(self, "acceleration", check.real_array(self.acceleration, "RigidBodyAcceleration.acceleration", ((3, 3),)))
        put(
            self,
            "cov_acceleration",
            check.real_array(self.cov_acceleration, "RigidBodyAcceleration.cov_acceleration", ((3, 3), (3, 3))),
        )

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Waypoint(WaypointExt):
    """Where to go, and how close.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "position", check.real_array(self.position, "Waypoint.position", ((3, 3),)))
        put(self, "heading", check.real(self.heading, "Waypoint.heading"))
        put(self, "tol_position", check.real(self.tol_position, "Waypoint.tol_position"))
        put(self, "tol_heading", check.real(self.tol_heading, "Waypoint.tol_heading"))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Trajectory(TrajectoryExt):
    """A line to follow at a speed.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "speed", check.real(self.speed, "Trajectory.speed"))
        put(self, "points", check.real_array(self.points, "Trajectory.points", ((1, 1048576), (3, 3))))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Path(PathExt):
    """Poses to pass one after the other.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "Path.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "Path.time_stamp", Time))
        put(
            self,
            "waypoints",
            check.items(
                self.waypoints, "Path.waypoints", 0, 1048576, lambda v, w: check.instance(v, w, TransformWithCovariance)
            ),
        )
        self._check_together()

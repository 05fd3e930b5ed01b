# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/position_state.asn by cdff generate; do not edit.

"""Types of ``asn1/position_state.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message
from cdff_common.types.pose_trajectory import PoseTrajectory


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateMetadata(Message):
    """Type ``PositionState-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Metadata"
    msg_version: int = 2
    producer_id: str = ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateLinks(Message):
    """Correlation of the errors of the poses in the timeline; errors: pose, gyro bias.

    Attributes
    ----------
    covariances : NDArray[np.float64], shape (n, 9)
        9 rows per pose.
    links : NDArray[np.float64], shape (n, 9)
        9 rows per pose: covariance of its errors with those of the previous pose.
    pins : NDArray[np.int64], shape (n,)
        us since the UNIX epoch: times that are not evicted.
    broken : NDArray[np.int64], shape (n,)
        us since the UNIX epoch: poses at the end of an evicted interval.
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Links"
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 9), np.float64))
    links: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 9), np.float64))
    pins: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    broken: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateFilter(Message):
    """Filter state at the time of the newest pose; clones are the reference poses of the next increments.

    Attributes
    ----------
    start : NDArray[np.float64], shape (n, 7)
        T_odom_base of the first pose: x y z (m), qx qy qz qw.
    start_covariance : NDArray[np.float64], shape (n, 36)
    body : NDArray[np.float64], shape (n, 7)
        T_site_base.
    vectors : NDArray[np.float64], shape (n, 3)
        velocity (m/s), gyro bias (rad/s), accelerometer bias (m/s2), slip; gravity (m/s2, 0 unknown), wheel speed (m/s), consecutive refusals; rotation errors of the mounts of IMU, visual and lidar odometry (rad); offsets of the corrected stamps of wheels, visual and lidar odometry, and the corrections (s); per clone factor on variances, refusals, 0, and velocity (m/s).
    names : tuple[str, ...]
        of the clones.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, of each clone.
    poses : NDArray[np.float64], shape (n, 7)
        T_site_clone.
    measured : NDArray[np.float64], shape (n, 7)
        pose reported by the source at that time: T_origin_sensor.
    measured_covariances : NDArray[np.float64], shape (n, 36)
        6x6 rows per clone; NaN where unknown.
    covariance : NDArray[np.float64], shape (n, 6)
        square matrix of all errors in rows of 6: 30 of the core, 6 per clone.
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Filter"
    start: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    start_covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))
    body: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    vectors: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    names: tuple[str, ...] = ()
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    measured: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    measured_covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))
    covariance: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateJoints(Message):
    """Values of the joints, concatenated, each in ascending order of time.

    Attributes
    ----------
    names : tuple[str, ...]
    counts : NDArray[np.int64], shape (n,)
        number of values of each joint.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch.
    values : NDArray[np.float64], shape (n,)
        rad or m.
    broken : NDArray[np.int64], shape (n,)
        indices of values at the end of an evicted interval.
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Joints"
    names: tuple[str, ...] = ()
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0, np.float64))
    broken: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionState(Message):
    """Timeline with its correlations, filter state, and joints.

    Attributes
    ----------
    metadata : PositionStateMetadata
    line : PoseTrajectory
    links : PositionStateLinks
    filter : PositionStateFilter
    joints : PositionStateJoints
    """

    ASN1_NAME: ClassVar[str] = "PositionState"
    metadata: PositionStateMetadata = field(default_factory=PositionStateMetadata)
    line: PoseTrajectory = field(default_factory=PoseTrajectory)
    links: PositionStateLinks = field(default_factory=PositionStateLinks)
    filter: PositionStateFilter = field(default_factory=PositionStateFilter)
    joints: PositionStateJoints = field(default_factory=PositionStateJoints)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/position_state.asn by cdff generate; do not edit.

"""Types of ``asn1/position_state.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.pose_trajectory import PoseTrajectory


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateMetadata(Message):
    """What a ``PositionState-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Metadata"
    msg_version: int = 2
    producer_id: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "PositionStateMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "PositionStateMetadata.producer_id", 256))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateLinks(Message):
    """How the errors of the poses of the time line hang together; errors: pose, gyro bias.

    Attributes
    ----------
    covariances : NDArray[np.float64], shape (n, 9)
        9 rows for each pose.
    links : NDArray[np.float64], shape (n, 9)
        9 rows for each pose: its errors with those of the pose before.
    pins : NDArray[np.int64], shape (n,)
        us since the UNIX epoch: times that are kept.
    broken : NDArray[np.int64], shape (n,)
        us since the UNIX epoch: poses before which time was forgotten.
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Links"
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 9), np.float64))
    links: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 9), np.float64))
    pins: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    broken: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "covariances",
            check.typed_octets(self.covariances, "PositionStateLinks.covariances", 1073741824, "<f8", 9),
        )
        put(self, "links", check.typed_octets(self.links, "PositionStateLinks.links", 1073741824, "<f8", 9))
        put(self, "pins", check.typed_octets(self.pins, "PositionStateLinks.pins", 1073741824, "<i8", 0))
        put(self, "broken", check.typed_octets(self.broken, "PositionStateLinks.broken", 1073741824, "<i8", 0))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateFilter(Message):
    """The filter at the time of the newest pose; clones: poses from which the next increments count.

    Attributes
    ----------
    start : NDArray[np.float64], shape (n, 7)
        T_odom_base of the first pose: x y z (m), qx qy qz qw.
    start_covariance : NDArray[np.float64], shape (n, 36)
    body : NDArray[np.float64], shape (n, 7)
        T_site_base.
    vectors : NDArray[np.float64], shape (n, 3)
        velocity (m/s), gyro bias (rad/s), accelerometer bias (m/s2), slip; gravity (m/s2, 0 unknown), 0, 0.
    names : tuple[str, ...]
        of the clones.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, of each clone.
    poses : NDArray[np.float64], shape (n, 7)
        T_site_clone.
    measured : NDArray[np.float64], shape (n, 7)
        what the source said then: T_origin_sensor.
    measured_covariances : NDArray[np.float64], shape (n, 36)
        6x6 rows for each clone; NaN where unknown.
    covariance : NDArray[np.float64], shape (n, 6)
        rows of 6 of the square of all errors: 18 of the core, 6 for each clone.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "start", check.typed_octets(self.start, "PositionStateFilter.start", 1073741824, "<f8", 7))
        put(
            self,
            "start_covariance",
            check.typed_octets(self.start_covariance, "PositionStateFilter.start_covariance", 1073741824, "<f8", 36),
        )
        put(self, "body", check.typed_octets(self.body, "PositionStateFilter.body", 1073741824, "<f8", 7))
        put(self, "vectors", check.typed_octets(self.vectors, "PositionStateFilter.vectors", 1073741824, "<f8", 3))
        put(
            self,
            "names",
            check.items(self.names, "PositionStateFilter.names", 0, 64, lambda v, w: check.text(v, w, 256)),
        )
        put(self, "stamps", check.typed_octets(self.stamps, "PositionStateFilter.stamps", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "PositionStateFilter.poses", 1073741824, "<f8", 7))
        put(self, "measured", check.typed_octets(self.measured, "PositionStateFilter.measured", 1073741824, "<f8", 7))
        put(
            self,
            "measured_covariances",
            check.typed_octets(
                self.measured_covariances, "PositionStateFilter.measured_covariances", 1073741824, "<f8", 36
            ),
        )
        put(
            self,
            "covariance",
            check.typed_octets(self.covariance, "PositionStateFilter.covariance", 1073741824, "<f8", 6),
        )


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionStateJoints(Message):
    """Values of the joints, one after the other, each in rising order of time.

    Attributes
    ----------
    names : tuple[str, ...]
    counts : NDArray[np.int64], shape (n,)
        values of each joint.
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch.
    values : NDArray[np.float64], shape (n,)
        rad or m.
    broken : NDArray[np.int64], shape (n,)
        indices of values before which time was forgotten.
    """

    ASN1_NAME: ClassVar[str] = "PositionState-Joints"
    names: tuple[str, ...] = ()
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    values: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0, np.float64))
    broken: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(
            self,
            "names",
            check.items(self.names, "PositionStateJoints.names", 0, 256, lambda v, w: check.text(v, w, 256)),
        )
        put(self, "counts", check.typed_octets(self.counts, "PositionStateJoints.counts", 1073741824, "<i8", 0))
        put(self, "stamps", check.typed_octets(self.stamps, "PositionStateJoints.stamps", 1073741824, "<i8", 0))
        put(self, "values", check.typed_octets(self.values, "PositionStateJoints.values", 1073741824, "<f8", 0))
        put(self, "broken", check.typed_octets(self.broken, "PositionStateJoints.broken", 1073741824, "<i8", 0))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PositionState(Message):
    """Time line, how its errors hang together, the filter's state, and the joints.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "PositionState.metadata", PositionStateMetadata))
        put(self, "line", check.instance(self.line, "PositionState.line", PoseTrajectory))
        put(self, "links", check.instance(self.links, "PositionState.links", PositionStateLinks))
        put(self, "filter", check.instance(self.filter, "PositionState.filter", PositionStateFilter))
        put(self, "joints", check.instance(self.joints, "PositionState.joints", PositionStateJoints))

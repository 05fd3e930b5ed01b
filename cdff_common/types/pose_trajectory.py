# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pose_trajectory.asn by cdff generate; do not edit.

"""Types of ``asn1/pose_trajectory.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.pose_trajectory_ext import PoseTrajectoryDataExt, PoseTrajectoryExt


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseTrajectoryMetadata(Message):
    """What a ``PoseTrajectory-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    parent_frame_id : str, at most 256 octets
    child_frame_id : str, at most 256 octets
    """

    ASN1_NAME: ClassVar[str] = "PoseTrajectory-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    parent_frame_id: str = ""
    child_frame_id: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "PoseTrajectoryMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "PoseTrajectoryMetadata.producer_id", 256))
        put(self, "parent_frame_id", check.text(self.parent_frame_id, "PoseTrajectoryMetadata.parent_frame_id", 256))
        put(self, "child_frame_id", check.text(self.child_frame_id, "PoseTrajectoryMetadata.child_frame_id", 256))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseTrajectoryData(PoseTrajectoryDataExt):
    """What a ``PoseTrajectory-Data`` of the ASN.1 modules holds.

    Attributes
    ----------
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, rising.
    poses : NDArray[np.float64], shape (n, 7)
        T_parent_child: x y z (m), qx qy qz qw.
    covariances : NDArray[np.float64], shape (n, 36)
        none, or 6x6 rows for each pose: x y z rx ry rz in the parent; NaN where unknown.
    """

    ASN1_NAME: ClassVar[str] = "PoseTrajectory-Data"
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "stamps", check.typed_octets(self.stamps, "PoseTrajectoryData.stamps", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "PoseTrajectoryData.poses", 1073741824, "<f8", 7))
        put(
            self,
            "covariances",
            check.typed_octets(self.covariances, "PoseTrajectoryData.covariances", 1073741824, "<f8", 36),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseTrajectory(PoseTrajectoryExt):
    """Poses of one frame in another at rising times.

    Attributes
    ----------
    metadata : PoseTrajectoryMetadata
    data : PoseTrajectoryData
    """

    ASN1_NAME: ClassVar[str] = "PoseTrajectory"
    metadata: PoseTrajectoryMetadata = field(default_factory=PoseTrajectoryMetadata)
    data: PoseTrajectoryData = field(default_factory=PoseTrajectoryData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "PoseTrajectory.metadata", PoseTrajectoryMetadata))
        put(self, "data", check.instance(self.data, "PoseTrajectory.data", PoseTrajectoryData))
        self._check_together()

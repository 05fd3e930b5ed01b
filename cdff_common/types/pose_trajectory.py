# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pose_trajectory.asn by cdff generate; do not edit.

"""Types of ``asn1/pose_trajectory.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import Message, PoseMessage
from cdff_common.types.pose_trajectory_ext import PoseTrajectoryExt


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseTrajectoryMetadata(Message):
    """Type ``PoseTrajectory-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    parent_frame_id : str, at most 256 bytes
    child_frame_id : str, at most 256 bytes
    """

    ASN1_NAME: ClassVar[str] = "PoseTrajectory-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    parent_frame_id: str = ""
    child_frame_id: str = ""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseTrajectoryData(Message):
    """Type ``PoseTrajectory-Data`` of the ASN.1 modules.

    Attributes
    ----------
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, ascending.
    poses : NDArray[np.float64], shape (n, 7)
        T_parent_child: x y z (m), qx qy qz qw.
    covariances : NDArray[np.float64], shape (n, 36)
        none, or 6x6 rows per pose: x y z rx ry rz in the parent; NaN where unknown.
    """

    ASN1_NAME: ClassVar[str] = "PoseTrajectory-Data"
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PoseTrajectory(PoseTrajectoryExt, PoseMessage):
    """Poses of one frame in another, in ascending order of time.

    Attributes
    ----------
    metadata : PoseTrajectoryMetadata
    data : PoseTrajectoryData
    """

    ASN1_NAME: ClassVar[str] = "PoseTrajectory"
    metadata: PoseTrajectoryMetadata = field(default_factory=PoseTrajectoryMetadata)
    data: PoseTrajectoryData = field(default_factory=PoseTrajectoryData)

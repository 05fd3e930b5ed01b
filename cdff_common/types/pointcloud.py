# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pointcloud.asn by cdff generate; do not edit.

"""Types of ``asn1/pointcloud.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import FramedMessage, Message
from cdff_common.types.pointcloud_ext import OctreeExt, PointcloudExt
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointCloudMetadata(Message):
    """Time, frame and sensor pose of a cloud.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the points.
    time_stamp : Time
        of capture; its end if it took time.
    height : int, 0..4294967295
        rows of an ordered cloud, else 1.
    width : int, 0..4294967295
        columns of an ordered cloud, else the number of points.
    is_registered : bool
    is_ordered : bool
    has_fixed_transform : bool
        true if pose-fixedFrame-robotFrame is known.
    pose_robot_frame_sensor_frame : TransformWithCovariance
    pose_fixed_frame_robot_frame : TransformWithCovariance
    """

    ASN1_NAME: ClassVar[str] = "PointCloud-Metadata"
    msg_version: int = 1
    sensor_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)
    height: int = 0
    width: int = 0
    is_registered: bool = False
    is_ordered: bool = False
    has_fixed_transform: bool = False
    pose_robot_frame_sensor_frame: TransformWithCovariance = field(default_factory=TransformWithCovariance)
    pose_fixed_frame_robot_frame: TransformWithCovariance = field(default_factory=TransformWithCovariance)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointCloudData(Message):
    """Points with optional colours and intensities.

    Attributes
    ----------
    points : NDArray[np.float64], shape (0..16777216, 3)
        m, x y z.
    colors : NDArray[np.float64], shape (0..16777216, 3)
        r g b; none or one per point.
    intensity : NDArray[np.int32], shape (0..16777216,)
        none or one per point.
    """

    ASN1_NAME: ClassVar[str] = "PointCloud-Data"
    points: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    colors: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    intensity: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0,), np.int32))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pointcloud(PointcloudExt, FramedMessage):
    """Point cloud in one frame at one time.

    Attributes
    ----------
    metadata : PointCloudMetadata
    data : PointCloudData
    """

    ASN1_NAME: ClassVar[str] = "Pointcloud"
    metadata: PointCloudMetadata = field(default_factory=PointCloudMetadata)
    data: PointCloudData = field(default_factory=PointCloudData)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Octree(OctreeExt):
    """Type ``Octree`` of the ASN.1 modules.

    Attributes
    ----------
    resolution : float
        m.
    point_cloud : Pointcloud
        centres of the occupied leaves.
    """

    ASN1_NAME: ClassVar[str] = "Octree"
    resolution: float = 0.0
    point_cloud: Pointcloud = field(default_factory=Pointcloud)

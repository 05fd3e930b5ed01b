# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/pointcloud.asn by cdff generate; do not edit.

"""Types of ``asn1/pointcloud.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.pointcloud_ext import OctreeExt, PointCloudDataExt, PointcloudExt
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointCloudMetadata(Message):
    """Where and when a cloud was taken, and where its sensor sat.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of the points.
    time_stamp : Time
        of capture; the end of it where it took time.
    height : int, 0..4294967295
        rows of an ordered cloud, else 1.
    width : int, 0..4294967295
        columns of an ordered cloud, else the number of points.
    is_registered : bool
    is_ordered : bool
    has_fixed_transform : bool
        whether pose-fixedFrame-robotFrame is known.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "PointCloudMetadata.msg_version", 0, 4294967295))
        put(self, "sensor_id", check.text(self.sensor_id, "PointCloudMetadata.sensor_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "PointCloudMetadata.frame_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "PointCloudMetadata.time_stamp", Time))
        put(self, "height", check.integer(self.height, "PointCloudMetadata.height", 0, 4294967295))
        put(self, "width", check.integer(self.width, "PointCloudMetadata.width", 0, 4294967295))
        put(self, "is_registered", check.boolean(self.is_registered, "PointCloudMetadata.is_registered"))
        put(self, "is_ordered", check.boolean(self.is_ordered, "PointCloudMetadata.is_ordered"))
        put(
            self,
            "has_fixed_transform",
            check.boolean(self.has_fixed_transform, "PointCloudMetadata.has_fixed_transform"),
        )
        put(
            self,
            "pose_robot_frame_sensor_frame",
            check.instance(
                self.pose_robot_frame_sensor_frame,
                "PointCloudMetadata.pose_robot_frame_sensor_frame",
                TransformWithCovariance,
            ),
        )
        put(
            self,
            "pose_fixed_frame_robot_frame",
            check.instance(
                self.pose_fixed_frame_robot_frame,
                "PointCloudMetadata.pose_fixed_frame_robot_frame",
                TransformWithCovariance,
            ),
        )

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class PointCloudData(PointCloudDataExt):
    """Points, and what is known of each.

    Attributes
    ----------
    points : NDArray[np.float64], shape (0..16777216, 3)
        m, x y z.
    colors : NDArray[np.float64], shape (0..16777216, 3)
        r g b; none or one for each point.
    intensity : NDArray[np.int32], shape (0..16777216,)
        none or one for each point.
    """

    ASN1_NAME: ClassVar[str] = "PointCloud-Data"
    points: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    colors: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    intensity: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0,), np.int32))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "points", check.real_array(self.points, "PointCloudData.points", ((0, 16777216), (3, 3))))
        put(self, "colors", check.real_array(self.colors, "PointCloudData.colors", ((0, 16777216), (3, 3))))
        put(
            self,
            "intensity",
            check.integer_array(
                self.intensity, "PointCloudData.intensity", ((0, 16777216),), -2147483648, 2147483647, "int32"
            ),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Pointcloud(PointcloudExt):
    """A cloud in one frame at one time.

    Attributes
    ----------
    metadata : PointCloudMetadata
    data : PointCloudData
    """

    ASN1_NAME: ClassVar[str] = "Pointcloud"
    metadata: PointCloudMetadata = field(default_factory=PointCloudMetadata)
    data: PointCloudData = field(default_factory=PointCloudData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "Pointcloud.metadata", PointCloudMetadata))
        put(self, "data", check.instance(self.data, "Pointcloud.data", PointCloudData))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Octree(OctreeExt):
    """What an ``Octree`` of the ASN.1 modules holds.

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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "resolution", check.real(self.resolution, "Octree.resolution"))
        put(self, "point_cloud", check.instance(self.point_cloud, "Octree.point_cloud", Pointcloud))
        self._check_together()

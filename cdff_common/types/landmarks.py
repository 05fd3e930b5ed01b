# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/landmarks.asn by cdff generate; do not edit.

"""Types of ``asn1/landmarks.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types import validation as check
from cdff_common.types.frame import Array3D, FrameIntrinsicT
from cdff_common.types.landmarks_ext import KeyFrameDataExt, KeyFrameExt, LandmarkMapDataExt, LandmarkMapExt
from cdff_common.types.message import Message
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LandmarkMapMetadata(Message):
    """What a ``LandmarkMap-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame of the positions.
    time_stamp : Time
        of the newest observation.
    descriptor_type : str, at most 256 octets
        ORB, SIFT, SHOT, ...; empty where there are no descriptors.
    """

    ASN1_NAME: ClassVar[str] = "LandmarkMap-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)
    descriptor_type: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "LandmarkMapMetadata.msg_version", 0, 4294967295))
        put(self, "producer_id", check.text(self.producer_id, "LandmarkMapMetadata.producer_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "LandmarkMapMetadata.frame_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "LandmarkMapMetadata.time_stamp", Time))
        put(self, "descriptor_type", check.text(self.descriptor_type, "LandmarkMapMetadata.descriptor_type", 256))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LandmarkMapData(LandmarkMapDataExt):
    """Columns: one row for each landmark.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        each once.
    positions : NDArray[np.float64], shape (n, 3)
        m, x y z.
    covariances : NDArray[np.float64], shape (n, 9)
        m2, 3x3 rows; none or one for each landmark, NaN where unknown.
    observations : NDArray[np.uint32], shape (n,)
        how often it was seen; none or one for each landmark.
    descriptors : Array3D
        one row for each landmark, or no rows.
    """

    ASN1_NAME: ClassVar[str] = "LandmarkMap-Data"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 9), np.float64))
    observations: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    descriptors: Array3D = field(default_factory=Array3D)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "ids", check.typed_octets(self.ids, "LandmarkMapData.ids", 1073741824, "<i8", 0))
        put(self, "positions", check.typed_octets(self.positions, "LandmarkMapData.positions", 1073741824, "<f8", 3))
        put(
            self,
            "covariances",
            check.typed_octets(self.covariances, "LandmarkMapData.covariances", 1073741824, "<f8", 9),
        )
        put(
            self,
            "observations",
            check.typed_octets(self.observations, "LandmarkMapData.observations", 1073741824, "<u4", 0),
        )
        put(self, "descriptors", check.instance(self.descriptors, "LandmarkMapData.descriptors", Array3D))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LandmarkMap(LandmarkMapExt):
    """Points that were seen again and again, in one frame.

    Attributes
    ----------
    metadata : LandmarkMapMetadata
    data : LandmarkMapData
    """

    ASN1_NAME: ClassVar[str] = "LandmarkMap"
    metadata: LandmarkMapMetadata = field(default_factory=LandmarkMapMetadata)
    data: LandmarkMapData = field(default_factory=LandmarkMapData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "LandmarkMap.metadata", LandmarkMapMetadata))
        put(self, "data", check.instance(self.data, "LandmarkMap.data", LandmarkMapData))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class KeyFrameMetadata(Message):
    """What a ``KeyFrame-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    id : int, 0..9223372036854775807
    sensor_id : str, at most 256 octets
    time_stamp : Time
        of capture.
    descriptor_type : str, at most 256 octets
        ORB, SIFT, ...; empty where there are no descriptors.
    """

    ASN1_NAME: ClassVar[str] = "KeyFrame-Metadata"
    msg_version: int = 1
    id: int = 0
    sensor_id: str = ""
    time_stamp: Time = field(default_factory=Time)
    descriptor_type: str = ""

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "KeyFrameMetadata.msg_version", 0, 4294967295))
        put(self, "id", check.integer(self.id, "KeyFrameMetadata.id", 0, 9223372036854775807))
        put(self, "sensor_id", check.text(self.sensor_id, "KeyFrameMetadata.sensor_id", 256))
        put(self, "time_stamp", check.instance(self.time_stamp, "KeyFrameMetadata.time_stamp", Time))
        put(self, "descriptor_type", check.text(self.descriptor_type, "KeyFrameMetadata.descriptor_type", 256))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class KeyFrameData(KeyFrameDataExt):
    """Columns: one row for each key point.

    Attributes
    ----------
    keypoints : NDArray[np.float32], shape (n, 2)
        px, x right y down, centre of the top left pixel at 0 0.
    scales : NDArray[np.float32], shape (n,)
        px, diameter; none or one for each key point.
    landmarks : NDArray[np.int64], shape (n,)
        id of the landmark seen there, -1 where none; none or one for each key point.
    descriptors : Array3D
        one row for each key point, or no rows.
    """

    ASN1_NAME: ClassVar[str] = "KeyFrame-Data"
    keypoints: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    scales: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    landmarks: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    descriptors: Array3D = field(default_factory=Array3D)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "keypoints", check.typed_octets(self.keypoints, "KeyFrameData.keypoints", 1073741824, "<f4", 2))
        put(self, "scales", check.typed_octets(self.scales, "KeyFrameData.scales", 1073741824, "<f4", 0))
        put(self, "landmarks", check.typed_octets(self.landmarks, "KeyFrameData.landmarks", 1073741824, "<i8", 0))
        put(self, "descriptors", check.instance(self.descriptors, "KeyFrameData.descriptors", Array3D))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class KeyFrame(KeyFrameExt):
    """An image reduced to what a map keeps of it.

    Attributes
    ----------
    metadata : KeyFrameMetadata
    pose : TransformWithCovariance
        T_map_camera; camera x right, y down, z forward.
    intrinsic : FrameIntrinsicT
    data : KeyFrameData
    """

    ASN1_NAME: ClassVar[str] = "KeyFrame"
    metadata: KeyFrameMetadata = field(default_factory=KeyFrameMetadata)
    pose: TransformWithCovariance = field(default_factory=TransformWithCovariance)
    intrinsic: FrameIntrinsicT = field(default_factory=FrameIntrinsicT)
    data: KeyFrameData = field(default_factory=KeyFrameData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "KeyFrame.metadata", KeyFrameMetadata))
        put(self, "pose", check.instance(self.pose, "KeyFrame.pose", TransformWithCovariance))
        put(self, "intrinsic", check.instance(self.intrinsic, "KeyFrame.intrinsic", FrameIntrinsicT))
        put(self, "data", check.instance(self.data, "KeyFrame.data", KeyFrameData))
        self._check_together()

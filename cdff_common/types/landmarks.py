# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/landmarks.asn by cdff generate; do not edit.

"""Types of ``asn1/landmarks.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.frame import Array3D, FrameIntrinsicT
from cdff_common.types.landmarks_ext import KeyFrameExt, LandmarkMapExt
from cdff_common.types.message import FramedMessage, Message
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LandmarkMapMetadata(Message):
    """Type ``LandmarkMap-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the positions.
    time_stamp : Time
        of the newest observation.
    descriptor_type : str, at most 256 bytes
        ORB, SIFT, SHOT, ...; empty without descriptors.
    """

    ASN1_NAME: ClassVar[str] = "LandmarkMap-Metadata"
    msg_version: int = 1
    producer_id: str = ""
    frame_id: str = ""
    time_stamp: Time = field(default_factory=Time)
    descriptor_type: str = ""

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LandmarkMapData(Message):
    """Columns with one row per landmark.

    Attributes
    ----------
    ids : NDArray[np.int64], shape (n,)
        unique.
    positions : NDArray[np.float64], shape (n, 3)
        m, x y z.
    covariances : NDArray[np.float64], shape (n, 9)
        m2, 3x3 rows; none or one per landmark, NaN where unknown.
    observations : NDArray[np.uint32], shape (n,)
        number of observations; none or one per landmark.
    descriptors : Array3D
        one row per landmark, or no rows.
    """

    ASN1_NAME: ClassVar[str] = "LandmarkMap-Data"
    ids: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    positions: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 3), np.float64))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 9), np.float64))
    observations: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, np.uint32))
    descriptors: Array3D = field(default_factory=Array3D)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class LandmarkMap(LandmarkMapExt, FramedMessage):
    """Points in one frame that were observed repeatedly.

    Attributes
    ----------
    metadata : LandmarkMapMetadata
    data : LandmarkMapData
    """

    ASN1_NAME: ClassVar[str] = "LandmarkMap"
    metadata: LandmarkMapMetadata = field(default_factory=LandmarkMapMetadata)
    data: LandmarkMapData = field(default_factory=LandmarkMapData)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class KeyFrameMetadata(Message):
    """Type ``KeyFrame-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    id : int, 0..9223372036854775807
    sensor_id : str, at most 256 bytes
    time_stamp : Time
        of capture.
    descriptor_type : str, at most 256 bytes
        ORB, SIFT, ...; empty without descriptors.
    """

    ASN1_NAME: ClassVar[str] = "KeyFrame-Metadata"
    msg_version: int = 1
    id: int = 0
    sensor_id: str = ""
    time_stamp: Time = field(default_factory=Time)
    descriptor_type: str = ""

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class KeyFrameData(Message):
    """Columns with one row per keypoint.

    Attributes
    ----------
    keypoints : NDArray[np.float32], shape (n, 2)
        px, x right y down, centre of the top left pixel at 0 0.
    scales : NDArray[np.float32], shape (n,)
        px, diameter; none or one per keypoint.
    landmarks : NDArray[np.int64], shape (n,)
        id of the observed landmark, -1 for none; none or one per keypoint.
    descriptors : Array3D
        one row per keypoint, or no rows.
    """

    ASN1_NAME: ClassVar[str] = "KeyFrame-Data"
    keypoints: NDArray[np.float32] = field(default_factory=lambda: np.zeros((0, 2), np.float32))
    scales: NDArray[np.float32] = field(default_factory=lambda: np.zeros(0, np.float32))
    landmarks: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    descriptors: Array3D = field(default_factory=Array3D)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class KeyFrame(KeyFrameExt):
    """Keyframe: pose, keypoints and descriptors of an image.

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

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns

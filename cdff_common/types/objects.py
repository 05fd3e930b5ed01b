# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/objects.asn by cdff generate; do not edit.

"""Types of ``asn1/objects.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.message import FramedMessage, Message
from cdff_common.types.objects_ext import ObjectDetectionExt, ObjectTrackExt
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectDetection(ObjectDetectionExt):
    """Detection of one object in one measurement.

    Attributes
    ----------
    label : str, at most 256 bytes
        class.
    score : float
        0 to 1.
    pose : TransformWithCovariance
        T_sensor_object; without frames if only the image box is known.
    size : NDArray[np.float64], shape (3,)
        m, along the object's axes; 0 if unknown.
    image_box : NDArray[np.float64], shape (4,)
        px, left top width height; 0 without an image.
    symmetric_poses : NDArray[np.float64], shape (n, 7)
        T_sensor_object, equivalent to pose by symmetry: x y z (m), qx qy qz qw.
    """

    ASN1_NAME: ClassVar[str] = "ObjectDetection"
    label: str = ""
    score: float = 0.0
    pose: TransformWithCovariance = field(default_factory=TransformWithCovariance)
    size: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    image_box: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4,), np.float64))
    symmetric_poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectDetections(Message):
    """All detections of one measurement.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of capture.
    producer_id : str, at most 256 bytes
    sensor_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the sensor.
    detections : tuple[ObjectDetection, ...]
    """

    ASN1_NAME: ClassVar[str] = "ObjectDetections"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    producer_id: str = ""
    sensor_id: str = ""
    frame_id: str = ""
    detections: tuple[ObjectDetection, ...] = ()

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


class ObjectTrackStatusT(IntEnum):
    """track-COASTING: predicted, without a measurement at the time of the newest state."""

    TRACK_TENTATIVE = 0
    TRACK_CONFIRMED = 1
    TRACK_LOST = 2
    TRACK_COASTING = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectTrackMetadata(Message):
    """Type ``ObjectTrack-Metadata`` of the ASN.1 modules.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of the newest state.
    producer_id : str, at most 256 bytes
    frame_id : str, at most 256 bytes
        frame of the object's poses.
    track_id : int, 0..4294967295
    label : str, at most 256 bytes
    status : ObjectTrackStatusT
    score : float
        0 to 1.
    size : NDArray[np.float64], shape (3,)
        m, along the object's axes; 0 if unknown.
    """

    ASN1_NAME: ClassVar[str] = "ObjectTrack-Metadata"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    producer_id: str = ""
    frame_id: str = ""
    track_id: int = 0
    label: str = ""
    status: ObjectTrackStatusT = ObjectTrackStatusT.TRACK_TENTATIVE
    score: float = 0.0
    size: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectTrackData(Message):
    """Columns of equal length: one row per state.

    Attributes
    ----------
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, ascending.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_object: x y z (m; NaN while the range is not observable), qx qy qz qw.
    velocities : NDArray[np.float64], shape (n, 6)
        m/s and rad/s, in the frame; none or one per state.
    covariances : NDArray[np.float64], shape (n, 36)
        of the poses, 6x6 rows: x y z rx ry rz, in the frame; none or one per state.
    velocity_covariances : NDArray[np.float64], shape (n, 36)
        6x6 rows: vx vy vz wx wy wz, in the frame; none or one per state.
    bearings : NDArray[np.float64], shape (n, 6)
        azimuth, elevation, sigma across and up (rad), range and sigma (m or NaN); none or one per state.
    pixels : NDArray[np.float64], shape (n, 2)
        column and row in the image; NaN where not seen; none or one per state.
    pixel_sigmas : NDArray[np.float64], shape (n, 2)
        of the pixels; none or one per state.
    """

    ASN1_NAME: ClassVar[str] = "ObjectTrack-Data"
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    velocities: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6), np.float64))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))
    velocity_covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))
    bearings: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6), np.float64))
    pixels: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2), np.float64))
    pixel_sigmas: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 2), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectTrack(ObjectTrackExt, FramedMessage):
    """Track of one object over time.

    Attributes
    ----------
    metadata : ObjectTrackMetadata
    data : ObjectTrackData
    """

    ASN1_NAME: ClassVar[str] = "ObjectTrack"
    metadata: ObjectTrackMetadata = field(default_factory=ObjectTrackMetadata)
    data: ObjectTrackData = field(default_factory=ObjectTrackData)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns

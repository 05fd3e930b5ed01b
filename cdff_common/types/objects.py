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

from cdff_common.types import validation as check
from cdff_common.types.message import Message
from cdff_common.types.objects_ext import ObjectDetectionExt, ObjectDetectionsExt, ObjectTrackDataExt, ObjectTrackExt
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectDetection(ObjectDetectionExt):
    """One object in one measurement.

    Attributes
    ----------
    label : str, at most 256 octets
        what it is held to be.
    score : float
        0 to 1.
    pose : TransformWithCovariance
        T_sensor_object; without frames where only the image is known.
    size : NDArray[np.float64], shape (3,)
        m, along the object's axes; 0 where unknown.
    image_box : NDArray[np.float64], shape (4,)
        px, left top width height; 0 where it was not seen in an image.
    """

    ASN1_NAME: ClassVar[str] = "ObjectDetection"
    label: str = ""
    score: float = 0.0
    pose: TransformWithCovariance = field(default_factory=TransformWithCovariance)
    size: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3,), np.float64))
    image_box: NDArray[np.float64] = field(default_factory=lambda: np.zeros((4,), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "label", check.text(self.label, "ObjectDetection.label", 256))
        put(self, "score", check.real(self.score, "ObjectDetection.score"))
        put(self, "pose", check.instance(self.pose, "ObjectDetection.pose", TransformWithCovariance))
        put(self, "size", check.real_array(self.size, "ObjectDetection.size", ((3, 3),)))
        put(self, "image_box", check.real_array(self.image_box, "ObjectDetection.image_box", ((4, 4),)))
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectDetections(ObjectDetectionsExt):
    """All detections of one measurement.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of capture.
    producer_id : str, at most 256 octets
    sensor_id : str, at most 256 octets
    frame_id : str, at most 256 octets
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "ObjectDetections.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "ObjectDetections.time_stamp", Time))
        put(self, "producer_id", check.text(self.producer_id, "ObjectDetections.producer_id", 256))
        put(self, "sensor_id", check.text(self.sensor_id, "ObjectDetections.sensor_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "ObjectDetections.frame_id", 256))
        put(
            self,
            "detections",
            check.items(
                self.detections,
                "ObjectDetections.detections",
                0,
                4096,
                lambda v, w: check.instance(v, w, ObjectDetection),
            ),
        )
        self._check_together()


class ObjectTrackStatusT(IntEnum):
    """``ObjectTrack-status-t``."""

    TRACK_TENTATIVE = 0
    TRACK_CONFIRMED = 1
    TRACK_LOST = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectTrackMetadata(Message):
    """What an ``ObjectTrack-Metadata`` of the ASN.1 modules holds.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of the newest state.
    producer_id : str, at most 256 octets
    frame_id : str, at most 256 octets
        frame in which the object moves.
    track_id : int, 0..4294967295
    label : str, at most 256 octets
    status : ObjectTrackStatusT
    score : float
        0 to 1.
    size : NDArray[np.float64], shape (3,)
        m, along the object's axes; 0 where unknown.
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

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "msg_version", check.integer(self.msg_version, "ObjectTrackMetadata.msg_version", 0, 4294967295))
        put(self, "time_stamp", check.instance(self.time_stamp, "ObjectTrackMetadata.time_stamp", Time))
        put(self, "producer_id", check.text(self.producer_id, "ObjectTrackMetadata.producer_id", 256))
        put(self, "frame_id", check.text(self.frame_id, "ObjectTrackMetadata.frame_id", 256))
        put(self, "track_id", check.integer(self.track_id, "ObjectTrackMetadata.track_id", 0, 4294967295))
        put(self, "label", check.text(self.label, "ObjectTrackMetadata.label", 256))
        put(self, "status", check.enumeration(self.status, "ObjectTrackMetadata.status", ObjectTrackStatusT))
        put(self, "score", check.real(self.score, "ObjectTrackMetadata.score"))
        put(self, "size", check.real_array(self.size, "ObjectTrackMetadata.size", ((3, 3),)))

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectTrackData(ObjectTrackDataExt):
    """Columns of one length: one row for each state.

    Attributes
    ----------
    stamps : NDArray[np.int64], shape (n,)
        us since the UNIX epoch, rising.
    poses : NDArray[np.float64], shape (n, 7)
        T_frame_object: x y z (m), qx qy qz qw.
    velocities : NDArray[np.float64], shape (n, 6)
        m/s and rad/s, in the frame; none or one for each state.
    covariances : NDArray[np.float64], shape (n, 36)
        of the poses, 6x6 rows: x y z rx ry rz, in the frame; none or one for each state.
    """

    ASN1_NAME: ClassVar[str] = "ObjectTrack-Data"
    stamps: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, np.int64))
    poses: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 7), np.float64))
    velocities: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 6), np.float64))
    covariances: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0, 36), np.float64))

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "stamps", check.typed_octets(self.stamps, "ObjectTrackData.stamps", 1073741824, "<i8", 0))
        put(self, "poses", check.typed_octets(self.poses, "ObjectTrackData.poses", 1073741824, "<f8", 7))
        put(self, "velocities", check.typed_octets(self.velocities, "ObjectTrackData.velocities", 1073741824, "<f8", 6))
        put(
            self,
            "covariances",
            check.typed_octets(self.covariances, "ObjectTrackData.covariances", 1073741824, "<f8", 36),
        )
        self._check_together()


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class ObjectTrack(ObjectTrackExt):
    """One object over time.

    Attributes
    ----------
    metadata : ObjectTrackMetadata
    data : ObjectTrackData
    """

    ASN1_NAME: ClassVar[str] = "ObjectTrack"
    metadata: ObjectTrackMetadata = field(default_factory=ObjectTrackMetadata)
    data: ObjectTrackData = field(default_factory=ObjectTrackData)

    def __post_init__(self) -> None:
        put = object.__setattr__
        put(self, "metadata", check.instance(self.metadata, "ObjectTrack.metadata", ObjectTrackMetadata))
        put(self, "data", check.instance(self.data, "ObjectTrack.data", ObjectTrackData))
        self._check_together()

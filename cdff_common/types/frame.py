# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
# GENERATED from cdff_common/asn1/frame.asn by cdff generate; do not edit.

"""Types of ``asn1/frame.asn``."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from cdff_common.types.frame_ext import Array3DExt, FrameExt, FramePairExt
from cdff_common.types.message import Message
from cdff_common.types.pose import TransformWithCovariance
from cdff_common.types.time import Time


class Array3DDepthT(IntEnum):
    """Element type; the values are the depth codes of OpenCV."""

    DEPTH_8U = 0
    DEPTH_8S = 1
    DEPTH_16U = 2
    DEPTH_16S = 3
    DEPTH_32S = 4
    DEPTH_32F = 5
    DEPTH_64F = 6


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Array3D(Array3DExt):
    """Rows of pixels.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    rows : int, 0..4294967295
    cols : int, 0..4294967295
    channels : int, 0..4294967295
    depth : Array3DDepthT
    row_size : int, 0..4294967295
        bytes from one row to the next.
    data : NDArray[np.uint8], shape (n,)
        row-major, channels interleaved, little-endian.
    """

    ASN1_NAME: ClassVar[str] = "Array3D"
    msg_version: int = 1
    rows: int = 0
    cols: int = 0
    channels: int = 0
    depth: Array3DDepthT = Array3DDepthT.DEPTH_8U
    row_size: int = 0
    data: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))


class FramePixelModelT(IntEnum):
    """``Frame-pixelModel-t``."""

    PIX_UNDEF = 0
    PIX_POLY = 1
    PIX_DISP = 2


class FrameErrorTypeT(IntEnum):
    """``Frame-errorType-t``."""

    ERROR_UNDEFINED = 0
    ERROR_DEAD = 1
    ERROR_FILTERED = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrameErrorT(Message):
    """Type ``Frame-error-t`` of the ASN.1 modules.

    Attributes
    ----------
    type : FrameErrorTypeT
    value : float
        pixel value that represents this error.
    """

    ASN1_NAME: ClassVar[str] = "Frame-error-t"
    type: FrameErrorTypeT = FrameErrorTypeT.ERROR_UNDEFINED
    value: float = 0.0


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrameAttribT(Message):
    """Type ``Frame-attrib-t`` of the ASN.1 modules.

    Attributes
    ----------
    name : str, at most 256 bytes
    data : str, at most 256 bytes
    """

    ASN1_NAME: ClassVar[str] = "Frame-attrib-t"
    name: str = ""
    data: str = ""


class FrameModeT(IntEnum):
    """``Frame-mode-t``."""

    MODE_UNDEF = 0
    MODE_GRAY = 1
    MODE_RGB = 2
    MODE_RGBA = 3
    MODE_BGR = 4
    MODE_BGRA = 5
    MODE_HSV = 6
    MODE_HLS = 7
    MODE_YUV = 8
    MODE_UYVY = 9
    MODE_LAB = 10
    MODE_LUV = 11
    MODE_XYZ = 12
    MODE_YCRCB = 13
    MODE_RGB32 = 14
    MODE_BAYER_RGGB = 15
    MODE_BAYER_GRBG = 16
    MODE_BAYER_BGGR = 17
    MODE_BAYER_GBRG = 18
    MODE_PJPG = 19
    MODE_JPEG = 20
    MODE_PNG = 21


class FrameStatusT(IntEnum):
    """``Frame-status-t``."""

    STATUS_EMPTY = 0
    STATUS_VALID = 1
    STATUS_INVALID = 2


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrameMetadataT(Message):
    """Acquisition data of an image.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    time_stamp : Time
        of capture.
    received_time : Time
    pixel_model : FramePixelModelT
        conversion of a pixel to a physical value.
    pixel_coeffs : NDArray[np.float64], shape (0..100,)
    err_values : tuple[FrameErrorT, ...]
    attributes : tuple[FrameAttribT, ...]
    mode : FrameModeT
    status : FrameStatusT
    """

    ASN1_NAME: ClassVar[str] = "Frame-metadata-t"
    msg_version: int = 1
    time_stamp: Time = field(default_factory=Time)
    received_time: Time = field(default_factory=Time)
    pixel_model: FramePixelModelT = FramePixelModelT.PIX_UNDEF
    pixel_coeffs: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))
    err_values: tuple[FrameErrorT, ...] = ()
    attributes: tuple[FrameAttribT, ...] = ()
    mode: FrameModeT = FrameModeT.MODE_UNDEF
    status: FrameStatusT = FrameStatusT.STATUS_EMPTY

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.time_stamp.ns


class FrameCameraModelT(IntEnum):
    """``Frame-cameraModel-t``."""

    CAM_UNDEF = 0
    CAM_PINHOLE = 1
    CAM_FISHEYE = 2
    CAM_MAPS = 3


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrameIntrinsicT(Message):
    """Intrinsic parameters of the camera.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    sensor_id : str, at most 256 bytes
    camera_matrix : NDArray[np.float64], shape (3, 3)
        px.
    camera_model : FrameCameraModelT
    dist_coeffs : NDArray[np.float64], shape (0..100,)
    """

    ASN1_NAME: ClassVar[str] = "Frame-intrinsic-t"
    msg_version: int = 1
    sensor_id: str = ""
    camera_matrix: NDArray[np.float64] = field(default_factory=lambda: np.zeros((3, 3), np.float64))
    camera_model: FrameCameraModelT = FrameCameraModelT.CAM_UNDEF
    dist_coeffs: NDArray[np.float64] = field(default_factory=lambda: np.zeros((0,), np.float64))


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FrameExtrinsicT(Message):
    """Extrinsic parameters of the camera.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    has_fixed_transform : bool
        true if pose-fixedFrame-robotFrame is known.
    pose_robot_frame_sensor_frame : TransformWithCovariance
    pose_fixed_frame_robot_frame : TransformWithCovariance
    """

    ASN1_NAME: ClassVar[str] = "Frame-extrinsic-t"
    msg_version: int = 1
    has_fixed_transform: bool = False
    pose_robot_frame_sensor_frame: TransformWithCovariance = field(default_factory=TransformWithCovariance)
    pose_fixed_frame_robot_frame: TransformWithCovariance = field(default_factory=TransformWithCovariance)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Frame(FrameExt):
    """Image; camera frame x right, y down, z forward.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    metadata : FrameMetadataT
    intrinsic : FrameIntrinsicT
    extrinsic : FrameExtrinsicT
    data : Array3D
    """

    ASN1_NAME: ClassVar[str] = "Frame"
    msg_version: int = 1
    metadata: FrameMetadataT = field(default_factory=FrameMetadataT)
    intrinsic: FrameIntrinsicT = field(default_factory=FrameIntrinsicT)
    extrinsic: FrameExtrinsicT = field(default_factory=FrameExtrinsicT)
    data: Array3D = field(default_factory=Array3D)

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.metadata.time_stamp.ns


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class FramePair(FramePairExt):
    """Left and right image of the same time.

    Attributes
    ----------
    msg_version : int, 0..4294967295
    baseline : float
        m, from the left to the right camera.
    left : Frame
    right : Frame
    """

    ASN1_NAME: ClassVar[str] = "FramePair"
    msg_version: int = 1
    baseline: float = 0.0
    left: Frame = field(default_factory=Frame)
    right: Frame = field(default_factory=Frame)


class FrameCompressedModeT(IntEnum):
    """``Frame-compressed-mode-t``."""

    MODE_COMPRESSED_UNDEFINED = 0
    MODE_PJPG = 1


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class CompressedFrame(Message):
    """Image in a compressed file format.

    Attributes
    ----------
    ref_time : Time
    received_time : Time
    image : NDArray[np.uint8], shape (1..268435456,)
    attributes : tuple[FrameAttribT, ...]
    rows : int, 0..4294967295
    cols : int, 0..4294967295
    frame_mode : FrameCompressedModeT
    frame_status : FrameStatusT
    """

    ASN1_NAME: ClassVar[str] = "CompressedFrame"
    ref_time: Time = field(default_factory=Time)
    received_time: Time = field(default_factory=Time)
    image: NDArray[np.uint8] = field(default_factory=lambda: np.zeros((1,), np.uint8))
    attributes: tuple[FrameAttribT, ...] = field(default_factory=lambda: (FrameAttribT(),) * 1)
    rows: int = 0
    cols: int = 0
    frame_mode: FrameCompressedModeT = FrameCompressedModeT.MODE_COMPRESSED_UNDEFINED
    frame_status: FrameStatusT = FrameStatusT.STATUS_EMPTY

    @property
    def stamp_ns(self) -> int:
        """Time, nanoseconds."""
        return self.ref_time.ns

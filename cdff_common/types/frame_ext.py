# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Behaviour of images: conversion between arrays and the bytes of ``Array3D``."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry.uncertain_transform import UncertainTransform
from cdff_common.types.message import Message
from cdff_common.types.pointcloud_ext import mounting
from cdff_common.types.validation import read_only

#: Element types in the order of ``Array3D-depth-t``.
DEPTH_DTYPES = ("|u1", "|i1", "<u2", "<i2", "<i4", "<f4", "<f8")
_MODE_CHANNELS = {"GRAY": 1, "RGB": 3, "BGR": 3, "RGBA": 4, "BGRA": 4, "HSV": 3, "HLS": 3}


def depth_of(dtype: np.dtype[Any], where: str) -> types.Array3DDepthT:
    """Return the depth code of a dtype; raises InputError for an unsupported one."""
    name = dtype.newbyteorder("<").str
    if name not in DEPTH_DTYPES:
        raise InputError(f"{where}: dtype {dtype}, expected one of {', '.join(DEPTH_DTYPES)}")
    return types.Array3DDepthT(DEPTH_DTYPES.index(name))


class Array3DExt(Message):
    """Image-like array."""

    __slots__ = ()
    rows: int
    cols: int
    channels: int
    depth: types.Array3DDepthT
    row_size: int
    data: NDArray[np.uint8]

    @classmethod
    def from_array(cls, array: NDArray[Any]) -> types.Array3D:
        """Return the message of ``(rows, cols)`` or ``(rows, cols, channels)``, rows without padding."""
        if array.ndim not in (2, 3):
            raise InputError(f"Array3D: shape {array.shape}, expected (rows, cols) or (rows, cols, channels)")
        depth = depth_of(array.dtype, "Array3D")
        dense = np.ascontiguousarray(array, dtype=DEPTH_DTYPES[depth])
        channels = 1 if array.ndim == 2 else array.shape[2]
        row_size = array.shape[1] * channels * dense.itemsize
        return types.Array3D(
            rows=array.shape[0],
            cols=array.shape[1],
            channels=channels,
            depth=depth,
            row_size=row_size,
            data=dense.reshape(-1).view(np.uint8),
        )

    @property
    def array(self) -> NDArray[Any]:
        """Return a read-only view ``(rows, cols)``, or ``(rows, cols, channels)`` for several channels.

        Raises
        ------
        InputError
            If the number of bytes does not match rows, columns, channels, depth and row size.
        """
        dtype = np.dtype(DEPTH_DTYPES[self.depth])
        row_bytes = self.cols * self.channels * dtype.itemsize
        stride = self.row_size or row_bytes
        expected_bytes = 0 if self.rows == 0 else (self.rows - 1) * stride + row_bytes
        if (
            stride < row_bytes
            or len(self.data) < expected_bytes
            or (dtype.itemsize and stride % dtype.itemsize)
        ):
            raise InputError(
                f"Array3D: {len(self.data)} bytes, row size {self.row_size}: expected {expected_bytes} for "
                f"{self.rows}x{self.cols}x{self.channels} of {dtype.name}"
            )
        shape = (self.rows, self.cols) if self.channels == 1 else (self.rows, self.cols, self.channels)
        if expected_bytes == 0:
            return read_only(np.zeros(shape, dtype))
        strides = (stride, self.channels * dtype.itemsize, dtype.itemsize)[: len(shape)]
        view: NDArray[Any] = np.ndarray(shape, dtype, self.data.data, 0, strides)
        view.flags.writeable = False
        return view


class FrameExt(Message):
    """Image with its camera."""

    __slots__ = ()
    metadata: types.FrameMetadataT
    intrinsic: types.FrameIntrinsicT
    extrinsic: types.FrameExtrinsicT
    data: types.Array3D

    @classmethod
    def from_image(
        cls,
        image: NDArray[Any],
        *,
        stamp_ns: int,
        mode: str = "GRAY",
        camera_matrix: ArrayLike | None = None,
        dist_coeffs: Sequence[float] | NDArray[np.float64] = (),
        camera_model: types.FrameCameraModelT | None = None,
        sensor: str = "",
        T_robot_sensor: UncertainTransform | None = None,
    ) -> types.Frame:
        """Return the message of an image ``(rows, cols[, channels])``.

        Parameters
        ----------
        mode : str
            Colour order: GRAY, RGB, BGR, ... (``Frame-mode-t`` without ``mode-``).
        camera_matrix : array_like, shape (3, 3), optional
            Pixels. Without it the camera model is undefined.
        dist_coeffs : sequence of float
            k1 k2 p1 p2 k3 ..., order of OpenCV; for another lens as ``CameraModel.message_coefficients``.
        camera_model : FrameCameraModelT, optional
            Lens of the camera; a pinhole if absent.
        sensor : str
            Frame of the camera.

        Raises
        ------
        InputError
            If the shape, dtype or mode is not supported.
        """
        data = types.Array3D.from_array(image)
        wire_mode = _mode(mode, data.channels)
        time = types.Time.from_ns(stamp_ns)
        robot_sensor, fixed_robot = mounting(T_robot_sensor, None, sensor, stamp_ns)
        has_camera = camera_matrix is not None
        return types.Frame(
            metadata=types.FrameMetadataT(
                time_stamp=time, received_time=time, mode=wire_mode, status=types.FrameStatusT.STATUS_VALID
            ),
            intrinsic=types.FrameIntrinsicT(
                sensor_id=sensor,
                camera_matrix=np.array(camera_matrix if has_camera else np.zeros((3, 3)), dtype=np.float64),
                camera_model=(camera_model or types.FrameCameraModelT.CAM_PINHOLE)
                if has_camera
                else types.FrameCameraModelT.CAM_UNDEF,
                dist_coeffs=np.array(dist_coeffs, dtype=np.float64),
            ),
            extrinsic=types.FrameExtrinsicT(
                pose_robot_frame_sensor_frame=robot_sensor, pose_fixed_frame_robot_frame=fixed_robot
            ),
            data=data,
        )

    @property
    def image(self) -> NDArray[Any]:
        """Read-only view of the pixels ``(rows, cols[, channels])``."""
        return self.data.array

    @property
    def camera_matrix(self) -> NDArray[np.float64]:
        """Camera matrix ``(3, 3)``, pixels; zeros where unknown."""
        return self.intrinsic.camera_matrix

    @property
    def frame(self) -> str:
        """Frame of the camera."""
        return self.intrinsic.sensor_id

    @property
    def T_robot_sensor(self) -> UncertainTransform | None:
        """Pose of the camera on the robot; None if unknown."""
        pose = self.extrinsic.pose_robot_frame_sensor_frame
        return pose.transform if pose.is_set else None


def _mode(mode: str, channels: int) -> types.FrameModeT:
    """Return the mode of a name; raises InputError if it is unknown or has another number of channels."""
    name = f"MODE_{mode.upper().replace('-', '_')}"
    if name not in types.FrameModeT.__members__:
        raise InputError(
            f"Frame mode {mode!r}: expected one of {', '.join(m.name[5:] for m in types.FrameModeT)}"
        )
    if (expected := _MODE_CHANNELS.get(mode.upper(), channels)) != channels:
        raise InputError(f"Frame mode {mode!r}: image has {channels} channels, expected {expected}")
    return types.FrameModeT[name]


class FramePairExt(Message):
    """Stereo pair."""

    __slots__ = ()
    baseline: float
    left: types.Frame
    right: types.Frame

    @classmethod
    def from_images(
        cls,
        left: NDArray[Any],
        right: NDArray[Any],
        *,
        baseline_m: float,
        camera_matrix: ArrayLike,
        stamp_ns: int,
        sensor: str = "",
        mode: str = "GRAY",
        T_robot_sensor: UncertainTransform | None = None,
    ) -> types.FramePair:
        """Return a rectified pair with one camera matrix; ``sensor`` and ``T_robot_sensor`` refer to the left
        camera.

        Raises
        ------
        InputError
            If the images differ in shape or dtype.
        """
        if left.shape != right.shape or left.dtype != right.dtype:
            raise InputError(
                f"FramePair: left {left.dtype} {left.shape}, right {right.dtype} {right.shape}: "
                "expected equal"
            )
        right_sensor = sensor.replace("left", "right")
        T_right = None
        if T_robot_sensor is not None:
            T_left_right = np.eye(4)
            T_left_right[0, 3] = baseline_m
            T_right = T_robot_sensor @ UncertainTransform.exact(T_left_right)
        return types.FramePair(
            baseline=baseline_m,
            left=types.Frame.from_image(
                left,
                stamp_ns=stamp_ns,
                mode=mode,
                camera_matrix=camera_matrix,
                sensor=sensor,
                T_robot_sensor=T_robot_sensor,
            ),
            right=types.Frame.from_image(
                right,
                stamp_ns=stamp_ns,
                mode=mode,
                camera_matrix=camera_matrix,
                sensor=right_sensor,
                T_robot_sensor=T_right,
            ),
        )

    @property
    def camera_matrix(self) -> NDArray[np.float64]:
        """Camera matrix ``(3, 3)`` of the left camera, pixels."""
        return self.left.intrinsic.camera_matrix

    @property
    def frame(self) -> str:
        """Frame of the left camera."""
        return self.left.intrinsic.sensor_id

    @property
    def stamp_ns(self) -> int:
        """Time of capture of the left image, nanoseconds."""
        return self.left.metadata.time_stamp.ns

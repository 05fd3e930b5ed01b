# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Streams of images, stereo pairs, depth images and poses whose samples are files or rows of an array."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera import CameraModel, StereoCalibration, check_image_size
from cdff_common.errors import CodecError, InputError
from cdff_common.geometry import UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import DistanceImage, Frame, FramePair, Time, TransformWithCovariance
from cdff_core.imaging.pair_rectifier import PairRectifier
from cdff_dev.logs.indexed import IndexedStream, headers
from cdff_dev.logs.source import split_stream
from services.ros_messages.compressed_images import decode_image

Stamps = NDArray[np.int64]
#: Suffixes of images that OpenCV reads.
IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".bmp", ".tif", ".tiff")
#: Depth values without a measurement, besides 0: the largest of 16 bits.
_NO_DEPTH = 65535


def read_image(path: Path, *, grey: bool = False) -> NDArray[Any]:
    """Read an image: ``(rows, cols)`` if it is grey, otherwise ``(rows, cols, 3)`` as blue, green and red.

    Raises
    ------
    CodecError
        If the file is not an image.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise CodecError(f"{path}: cannot be read: {error.strerror or error}") from error
    return decode_image(data, str(path), grey=grey)


def frame_stream(
    name: str,
    files: Sequence[Path],
    stamps_ns: Stamps,
    camera: CameraModel | None = None,
    T_robot_sensor: UncertainTransform | None = None,
) -> IndexedStream:
    """Return a stream of Frame, grey or in the order blue, green, red.

    Raises
    ------
    InputError
        If the camera does not fit the size of the first image.
    """
    sensor = _sensor(name)
    if camera is not None:
        _check_size(camera, files[0])

    def read(i: int) -> Frame:
        image = read_image(files[i])
        return Frame.from_image(
            image,
            stamp_ns=int(stamps_ns[i]),
            mode="GRAY" if image.ndim == 2 else "BGR",
            sensor=sensor,
            camera_matrix=None if camera is None else camera.matrix,
            dist_coeffs=() if camera is None else camera.message_coefficients,
            camera_model=None if camera is None else camera.message_model,
            T_robot_sensor=T_robot_sensor,
        )

    return IndexedStream(
        "Frame", stamps_ns, read, headers(name, stamps_ns, frame=sensor, producer=_sensor(name))
    )


def depth_stream(
    name: str, files: Sequence[Path], stamps_ns: Stamps, camera: CameraModel, unit_m: float
) -> IndexedStream:
    """Return a stream of DistanceImage: distances along the optical axis, 0 without a measurement.

    A pixel with column u, row v and distance d is the point ``d (u scale_x + center_x, v scale_y + center_y,
    1)``.

    Parameters
    ----------
    unit_m : float
        Metres of the value 1.

    Raises
    ------
    InputError
        If the camera does not fit the size of the first image, or has lens distortion.
    """
    sensor = _sensor(name)
    _check_size(camera, files[0])
    if not camera.is_ideal:
        raise InputError(f"{files[0].parent}: depth images with lens distortion, expected none")

    def read(i: int) -> DistanceImage:
        return read_depth_image(files[i], camera, unit_m, int(stamps_ns[i]))

    return IndexedStream(
        "DistanceImage", stamps_ns, read, headers(name, stamps_ns, frame=sensor, producer=sensor)
    )


def read_depth_image(path: Path, camera: CameraModel, unit_m: float, stamp_ns: int) -> DistanceImage:
    """Read a depth image of 16 bits; 0 and 65535 are no measurement.

    Raises
    ------
    CodecError
        If the file is not an image of one channel with 16 bits.
    """
    raw = read_image(path)
    if raw.ndim != 2 or raw.dtype != np.uint16:
        raise CodecError(f"{path}: {raw.dtype} {raw.shape}, expected a depth image of 16 bits")
    distances = np.where(raw == _NO_DEPTH, 0, raw) * unit_m
    return DistanceImage(
        ref_time=Time.from_ns(stamp_ns),
        width=raw.shape[1],
        height=raw.shape[0],
        scale_x=1.0 / camera.fx,
        scale_y=1.0 / camera.fy,
        center_x=-camera.cx / camera.fx,
        center_y=-camera.cy / camera.fy,
        data=distances.ravel(),
    )


def pair_stream(
    name: str,
    pairs: Sequence[tuple[Path, Path]],
    stamps_ns: Stamps,
    stereo: StereoCalibration,
    T_robot_left: UncertainTransform | None = None,
) -> IndexedStream:
    """Return a stream of rectified grey FramePair in the frame ``{sensor}_left``.

    Images of a calibration that is not that of a rectified pair are rectified; the frame of the sensor is
    then that of the rectified left camera.

    Raises
    ------
    InputError
        If the calibration does not fit the size of the first image, or cannot be rectified.
    """
    sensor = f"{_sensor(name)}_left"
    _check_size(stereo.left, pairs[0][0])
    rectifier = PairRectifier(stereo, sensor, T_robot_left)

    def read(i: int) -> FramePair:
        left, right = (read_image(path, grey=True) for path in pairs[i])
        return rectifier.pair(left, right, int(stamps_ns[i]))

    return IndexedStream(
        "FramePair", stamps_ns, read, headers(name, stamps_ns, frame=sensor, producer=_sensor(name))
    )


def pose_stream(name: str, T: FloatArray, stamps_ns: Stamps, *, parent: str, child: str) -> IndexedStream:
    """Return a stream of poses ``T_parent_child`` ``(n, 4, 4)`` without covariance."""
    robot, source, _ = split_stream(name)

    def read(i: int) -> TransformWithCovariance:
        return TransformWithCovariance.from_transform(
            UncertainTransform(T[i]), parent=parent, child=child, stamp_ns=int(stamps_ns[i]), producer=robot
        )

    header = headers(name, stamps_ns, frame=parent, child=child, producer=f"{robot}/{source}")
    return IndexedStream("TransformWithCovariance", stamps_ns, read, header)


def _sensor(stream: str) -> str:
    """Return the frame of the sensor of a stream: ``mana/navcam`` of ``/mana/navcam.pair``."""
    robot, sensor, _ = split_stream(stream)
    return f"{robot}/{sensor}"


def _check_size(camera: CameraModel, file: Path) -> None:
    rows, cols = read_image(file).shape[:2]
    check_image_size(camera, rows, cols, str(file.parent))

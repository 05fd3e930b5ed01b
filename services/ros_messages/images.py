# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ``sensor_msgs/Image`` and ``CompressedImage`` to Frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.camera import CameraModel, LensName, lens_named
from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameCameraModelT
from services.ros_messages.compressed_images import decode_image
from services.ros_messages.topics import Topic

#: Type of an element, number of channels and mode by the encoding of ROS.
_ENCODINGS = {
    "mono8": ("u1", 1, "GRAY"),
    "8UC1": ("u1", 1, "GRAY"),
    "mono16": ("u2", 1, "GRAY"),
    "16UC1": ("u2", 1, "GRAY"),
    "32FC1": ("f4", 1, "GRAY"),
    "rgb8": ("u1", 3, "RGB"),
    "bgr8": ("u1", 3, "BGR"),
    "8UC3": ("u1", 3, "BGR"),
}
#: Channels of encodings of 8 bits that become BGR, and OpenCV's name of the conversion.
_TO_BGR = {
    "bayer_rggb8": (1, "BayerRGGB2BGR"),
    "bayer_bggr8": (1, "BayerBGGR2BGR"),
    "bayer_gbrg8": (1, "BayerGBRG2BGR"),
    "bayer_grbg8": (1, "BayerGRBG2BGR"),
    "yuv422": (2, "YUV2BGR_UYVY"),
    "uyvy": (2, "YUV2BGR_UYVY"),
    "yuv422_yuy2": (2, "YUV2BGR_YUY2"),
    "yuyv": (2, "YUV2BGR_YUY2"),
    "rgba8": (4, "RGBA2BGR"),
    "bgra8": (4, "BGRA2BGR"),
}
#: Bytes in front of the image in messages of ``compressed_depth_image_transport``.
_DEPTH_HEADER_BYTES = 12


def pixels(message: Any) -> tuple[NDArray[Any], str]:
    """Return the pixels of an ``Image`` or ``CompressedImage``, and their mode: GRAY, RGB or BGR.

    Raises
    ------
    InputError
        If the encoding or the size is not supported, or the image cannot be decoded.
    """
    if not hasattr(message, "encoding"):
        data = np.asarray(message.data, np.uint8)
        if "compressedDepth" in message.format:
            data = data[_DEPTH_HEADER_BYTES:]
        image = decode_image(data, f"format {message.format!r}")
        return image, "GRAY" if image.ndim == 2 else "BGR"
    if message.encoding in _TO_BGR:
        import cv2

        channels, conversion = _TO_BGR[message.encoding]
        image = _rows(message, np.dtype("u1"), channels)
        return np.asarray(cv2.cvtColor(image, getattr(cv2, f"COLOR_{conversion}"))), "BGR"
    if message.encoding not in _ENCODINGS:
        known = ", ".join((*_ENCODINGS, *_TO_BGR))
        raise InputError(f"encoding {message.encoding!r}: expected one of {known}")
    kind, channels, mode = _ENCODINGS[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    return _rows(message, dtype, channels).astype(dtype.newbyteorder("="), copy=False), mode


def grey_pixels(message: Any) -> NDArray[Any]:
    """Return the pixels of a message in grey; raises InputError as ``pixels``."""
    image, mode = pixels(message)
    if mode == "GRAY":
        return image
    import cv2

    return np.asarray(cv2.cvtColor(image, cv2.COLOR_RGB2GRAY if mode == "RGB" else cv2.COLOR_BGR2GRAY))


def frame(message: Any, topic: Topic, stamp_ns: int) -> tuple[Frame, str, None]:
    """Return an image; raises InputError if it is not supported."""
    image, mode = pixels(message)
    name = topic.frame(message.header.frame_id)
    matrix, distortion, lens = _calibration(topic)
    value = Frame.from_image(
        image,
        stamp_ns=stamp_ns,
        mode=mode,
        sensor=name,
        camera_matrix=matrix,
        dist_coeffs=distortion,
        camera_model=lens,
    )
    return value, name, None


def camera_model(topic: Topic) -> CameraModel:
    """Return the camera of a topic of images; raises InputError if it has no usable ``CameraInfo``."""
    info = topic.camera
    matrix = camera_matrix(info, "k")
    if matrix is None or not matrix.any():
        raise InputError(
            f"{topic.name}: no CameraInfo with a camera matrix in its namespace; expected one, or "
            "--calibration FILE"
        )
    rows, cols = int(info.height), int(info.width)
    if topic.is_rectified:
        projection = camera_matrix(info, "p")
        ideal = matrix if projection is None else projection[:, :3]
        return CameraModel.from_matrix(ideal, rows=rows, cols=cols)
    return CameraModel.from_matrix(matrix, _distortion(info), rows=rows, cols=cols, lens=_lens(info))


def camera_matrix(info: Any, name: str) -> NDArray[np.float64] | None:
    """Return a matrix of three rows of a calibration, or None; its name is capital in ROS 1."""
    rows = next((getattr(info, n) for n in (name, name.upper()) if hasattr(info, n)), None)
    return None if rows is None or len(rows) % 3 else np.asarray(rows, np.float64).reshape(3, -1)


def _rows(message: Any, dtype: np.dtype[Any], channels: int) -> NDArray[Any]:
    """Return the elements of an image without the bytes at the end of each row."""
    width = message.width * channels * dtype.itemsize
    data = np.asarray(message.data, np.uint8)
    if message.step < width or data.size != message.step * message.height or not data.size:
        raise InputError(
            f"{data.size} bytes in rows of {message.step}: expected {message.height} rows of {width} or more"
        )
    rows = np.ascontiguousarray(data.reshape(message.height, message.step)[:, :width])
    image = rows.view(dtype).reshape(message.height, message.width, channels)
    return image[..., 0] if channels == 1 else image


def _calibration(
    topic: Topic,
) -> tuple[NDArray[np.float64] | None, NDArray[np.float64], FrameCameraModelT | None]:
    """Return camera matrix, coefficients and lens of the images, as ``Frame.from_image`` receives them.

    Rectified images have the projection matrix and no distortion; the matrix is None without a calibration.
    Raises InputError if the distortion model is unknown.
    """
    info = topic.camera
    matrix, projection = camera_matrix(info, "k"), camera_matrix(info, "p")
    if matrix is None or not matrix.any():
        return None, np.zeros(0), None
    if topic.is_rectified and projection is not None:
        return projection[:, :3], np.zeros(0), None
    lens = _lens(info)
    if lens == "pinhole":
        return matrix, np.array(_distortion(info)), FrameCameraModelT.CAM_PINHOLE
    camera = CameraModel.from_matrix(matrix, _distortion(info), lens=lens)
    return matrix, camera.message_coefficients, camera.message_model


def _distortion(info: Any) -> tuple[float, ...]:
    return tuple(float(d) for d in getattr(info, "D", getattr(info, "d", ())))


def _lens(info: Any) -> LensName:
    """Return the lens of a calibration; raises InputError if the model of its distortion is unknown."""
    try:
        return lens_named(info.distortion_model)
    except InputError:
        if any(_distortion(info)):
            raise
        return "pinhole"

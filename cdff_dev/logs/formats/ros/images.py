# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of ``sensor_msgs/Image`` and ``CompressedImage`` to Frame."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_dev.logs.formats.ros.topics import Topic

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
#: Distortion models with the parameters of OpenCV.
_OPENCV_MODELS = ("plumb_bob", "rational_polynomial")


def frame(message: Any, topic: Topic, stamp_ns: int) -> tuple[Frame, str, None]:
    """Return an image without compression; raises InputError if its encoding or size is not supported."""
    if message.encoding not in _ENCODINGS:
        raise InputError(f"encoding {message.encoding!r}: expected one of {', '.join(_ENCODINGS)}")
    kind, channels, mode = _ENCODINGS[message.encoding]
    dtype = np.dtype(kind).newbyteorder(">" if message.is_bigendian else "<")
    width = message.width * channels * dtype.itemsize
    data = np.asarray(message.data, np.uint8)
    if message.step < width or data.size != message.step * message.height:
        raise InputError(
            f"{data.size} bytes in rows of {message.step}: expected {message.height} rows of {width} or more"
        )
    rows = np.ascontiguousarray(data.reshape(message.height, message.step)[:, :width])
    image = rows.view(dtype).reshape(message.height, message.width, channels)
    image = image.astype(dtype.newbyteorder("="), copy=False)
    return _frame(image[..., 0] if channels == 1 else image, mode, message, topic, stamp_ns)


def compressed_frame(message: Any, topic: Topic, stamp_ns: int) -> tuple[Frame, str, None]:
    """Return a JPEG or PNG image; raises InputError if it cannot be decoded."""
    import cv2

    image = cv2.imdecode(np.asarray(message.data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"format {message.format!r}: not an image that can be decoded")
    return _frame(image, "GRAY" if image.ndim == 2 else "BGR", message, topic, stamp_ns)


def _frame(
    image: NDArray[Any], mode: str, message: Any, topic: Topic, stamp_ns: int
) -> tuple[Frame, str, None]:
    name = topic.frame(message.header.frame_id)
    matrix, distortion = _calibration(topic)
    value = Frame.from_image(
        image, stamp_ns=stamp_ns, mode=mode, sensor=name, camera_matrix=matrix, dist_coeffs=distortion
    )
    return value, name, None


def _calibration(topic: Topic) -> tuple[NDArray[np.float64] | None, tuple[float, ...]]:
    """Return camera matrix and distortion of the images; None without a calibration.

    Images whose topic contains ``rect`` are rectified, with the projection matrix and without distortion.
    Raises InputError if the distortion model is not ``plumb_bob``.
    """
    camera = topic.camera
    matrix, projection = (_matrix(camera, name) for name in ("kK", "pP"))
    if camera is None or matrix is None or not matrix.any():
        return None, ()
    if "rect" in topic.name.rpartition("/")[2] and projection is not None:
        return projection[:, :3], ()
    distortion = tuple(float(d) for d in getattr(camera, "D", getattr(camera, "d", ())))
    if any(distortion) and camera.distortion_model not in _OPENCV_MODELS:
        raise InputError(
            f"distortion model {camera.distortion_model!r}: expected {' or '.join(_OPENCV_MODELS)}"
        )
    return matrix, distortion


def _matrix(camera: Any, names: str) -> NDArray[np.float64] | None:
    """Return a matrix of three rows of a calibration, whose name is capital in ROS 1."""
    rows = next((getattr(camera, name) for name in names if hasattr(camera, name)), None)
    return None if rows is None else np.asarray(rows, np.float64).reshape(3, -1)

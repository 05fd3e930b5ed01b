# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of images of ROCK.

Images with a Bayer pattern become BGR by interpolation, UYVY becomes BGR, and compressed images are decoded.
A log has no calibration, so the camera matrix is unknown.
"""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameAttribT, FrameMetadataT, FrameModeT, FramePair, FrameStatusT, Time
from services.rock_types.values import Conversion, Converted, Source, stamp_ns

#: Channels and mode of images without compression. The fourth channel of RGB32 is unused.
_PLAIN = {
    "MODE_GRAYSCALE": (1, FrameModeT.MODE_GRAY),
    "MODE_RGB": (3, FrameModeT.MODE_RGB),
    "MODE_BGR": (3, FrameModeT.MODE_BGR),
    "MODE_RGB32": (4, FrameModeT.MODE_RGB32),
}
_BAYER = ("MODE_BAYER_RGGB", "MODE_BAYER_GRBG", "MODE_BAYER_BGGR", "MODE_BAYER_GBRG")
_COMPRESSED = ("MODE_PJPG", "MODE_JPEG", "MODE_PNG")
_MAX_TEXT = 256


def _frame(value: Any, source: Source, name: str) -> Frame:
    """Return the Frame of a ``base::samples::frame::Frame``."""
    image, mode = _image(value, source.order)
    plain = Frame.from_image(image, stamp_ns=source.stamp_ns, sensor=name, mode=mode.name[5:])
    received = stamp_ns(value["received_time"])
    metadata = FrameMetadataT(
        time_stamp=source.time,
        received_time=source.time if received is None else Time.from_ns(received),
        attributes=tuple(FrameAttribT(_short(a["name_"]), _short(a["data_"])) for a in value["attributes"]),
        mode=mode,
        status=FrameStatusT.__members__.get(value["frame_status"], FrameStatusT.STATUS_INVALID),
    )
    return Frame(metadata=metadata, intrinsic=plain.intrinsic, extrinsic=plain.extrinsic, data=plain.data)


def _short(text: str) -> str:
    """Return the part of a text that an attribute can hold."""
    return text.encode()[:_MAX_TEXT].decode("utf-8", "ignore")


def _image(value: Any, order: str) -> tuple[NDArray[Any], FrameModeT]:
    """Return the pixels of an image, and their mode; raises InputError if they are not in the data."""
    mode = value["frame_mode"]
    data = np.asarray(value["image"])
    height, width = int(value["size"]["height"]), int(value["size"]["width"])
    if mode in _COMPRESSED:
        return _decompress_image(data, mode, height, width)
    if mode == "MODE_UNDEFINED" and not data.size:
        return np.zeros((0, 0), np.uint8), FrameModeT.MODE_UNDEF
    import cv2

    if mode == "MODE_UYVY":
        pixels = _pixels(data, height, width, 2, np.dtype(np.uint8))
        return np.asarray(cv2.cvtColor(pixels, cv2.COLOR_YUV2BGR_UYVY)), FrameModeT.MODE_BGR
    dtype = _dtype(int(value["data_depth"]), order)
    if mode in _BAYER:
        pixels = _pixels(data, height, width, 1, dtype)
        return np.asarray(cv2.cvtColor(pixels, getattr(cv2, f"COLOR_{mode[5:]}2BGR"))), FrameModeT.MODE_BGR
    if mode in ("MODE_BAYER", "RAW_MODES"):
        return _pixels(data, height, width, 1, dtype), FrameModeT.MODE_UNDEF  # the pattern is not stated
    if mode not in _PLAIN:
        known = ", ".join((*_PLAIN, *_BAYER, "MODE_BAYER", "MODE_UYVY", *_COMPRESSED))
        raise InputError(f"image in mode {mode}: expected one of {known}")
    channels, frame_mode = _PLAIN[mode]
    return _pixels(data, height, width, channels, dtype), frame_mode


def _dtype(depth: int, order: str) -> np.dtype[Any]:
    """Return the type of an element of a number of effective bits."""
    if not 0 < depth <= 16:
        raise InputError(f"image of {depth} bits per channel: expected 1 to 16")
    return np.dtype(f"{order}u{1 if depth <= 8 else 2}")


def _pixels(data: NDArray[Any], height: int, width: int, channels: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the pixels ``(height, width[, channels])``; rows can be followed by unused bytes."""
    row = width * channels * dtype.itemsize
    stride = data.size // height if height else 0
    if not row or stride < row or stride * height != data.size:
        raise InputError(f"image of {data.size} bytes: expected {height} rows of {row} bytes")
    rows = np.ascontiguousarray(data.reshape(height, stride)[:, :row])
    shape = (height, width) if channels == 1 else (height, width, channels)
    return rows.view(dtype).reshape(shape).astype(dtype.newbyteorder("="), copy=False)


def _decompress_image(
    data: NDArray[Any], mode: str, height: int, width: int
) -> tuple[NDArray[Any], FrameModeT]:
    """Return a JPEG or PNG image, whose own size is read first: damaged ones can state any size."""
    import cv2
    from PIL import Image

    try:
        with Image.open(io.BytesIO(data.tobytes()), formats=("JPEG", "PNG")) as picture:
            size = picture.size
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise InputError(f"{mode} image of {data.size} bytes: {error}") from error
    if size != (width, height):
        raise InputError(f"{mode} image of {size[1]} x {size[0]} pixels: expected {height} x {width}")
    image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    if image is None:
        raise InputError(f"{mode} image of {data.size} bytes: damaged, expected {height} x {width} pixels")
    modes = {2: FrameModeT.MODE_GRAY, 3: FrameModeT.MODE_BGR, 4: FrameModeT.MODE_BGRA}
    return np.asarray(image), modes[2 if image.ndim == 2 else image.shape[2]]


def _single(value: Any, source: Source) -> Converted:
    return _frame(value, source, source.sensor_frame), source.sensor_frame, None


def _compressed_frame(value: Any, source: Source) -> Converted:
    """Return a ``CompressedFrame``, which has no depth."""
    return _single({"data_depth": 8, **value}, source)


def _pair(value: Any, source: Source) -> Converted:
    """Return both images as a pair with baseline 0, because the log does not contain the baseline."""
    left, right = f"{source.sensor_frame}_left", f"{source.sensor_frame}_right"
    pair = FramePair(left=_frame(value["first"], source, left), right=_frame(value["second"], source, right))
    return pair, left, None


_FIELDS = ("received_time", "image", "attributes", "size", "frame_mode", "frame_status")
IMAGES = {
    "/base/samples/frame/Frame": (
        Conversion("Frame", _single, (*_FIELDS, "data_depth"), ("time", "pixel_size", "row_size")),
    ),
    "/base/samples/frame/CompressedFrame": (Conversion("Frame", _compressed_frame, _FIELDS),),
    "/base/samples/frame/FramePair": (Conversion("FramePair", _pair, ("first", "second")),),
}

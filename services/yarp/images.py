# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images of YARP: a list of ``[mat]``, the format of the pixels, their layout, and the pixels."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError
from services.yarp.bottle import Vocab

#: Tags, number and contents of the header: list of 4, vocabulary, vocabulary, list of 5 numbers, blob.
_HEADER = struct.Struct("<iiiiiiiiiihhiiii")
_FIXED = (256, 4, 9, Vocab("mat").number, 9)
#: Mode, type and channels by the format of the pixels.
_FORMATS: dict[str, tuple[str, np.dtype[Any], int]] = {
    "mono": ("GRAY", np.dtype("u1"), 1),
    "mo16": ("GRAY", np.dtype("<u2"), 1),
    "rgb": ("RGB", np.dtype("u1"), 3),
    "bgr": ("BGR", np.dtype("u1"), 3),
}


def decode_yarp_image(data: bytes | memoryview) -> tuple[NDArray[Any], str]:
    """Return the pixels ``(rows, cols[, 3])`` of an image, and their mode: GRAY, RGB or BGR.

    Raises
    ------
    CodecError
        If the header is not that of an image, its format is not known, or the pixels do not fit its size.
    """
    if len(data) < _HEADER.size:
        raise CodecError(f"image of {len(data)} bytes: expected a header of {_HEADER.size}")
    numbers = _HEADER.unpack_from(data)
    *fixed, code, list_tag, list_size, pixel_bytes, size, quantum, top, cols, rows, blob_tag, blob = numbers
    if tuple(fixed) != _FIXED or (list_tag, list_size, blob_tag) != (257, 5, 12):
        raise CodecError("not an image: expected a list of [mat], a format, a layout and the pixels")
    name = str(Vocab.of_number(code))
    if name not in _FORMATS:
        raise CodecError(f"image of the format {name!r}: expected one of {', '.join(_FORMATS)}")
    mode, dtype, channels = _FORMATS[name]
    width = channels * dtype.itemsize
    padding = -cols * width % quantum if quantum > 0 else 0
    stride = cols * width + padding
    is_complete = len(data) - _HEADER.size == blob == size == rows * stride
    if not (rows > 0 and cols > 0 and pixel_bytes == width and top in (0, 1) and is_complete):
        raise CodecError(
            f"image {name} of {rows} x {cols} in {len(data) - _HEADER.size} bytes: expected {rows * stride}"
        )
    lines = np.frombuffer(data, np.uint8, offset=_HEADER.size).reshape(rows, stride)[:, : cols * width]
    image = np.ascontiguousarray(lines).view(dtype).reshape(rows, cols, channels)
    image = image[::-1] if top == 1 else image
    return (image[..., 0] if channels == 1 else image), mode


def encode_yarp_image(image: NDArray[Any], mode: str) -> bytes:
    """Return an image whose rows have no padding; raises CodecError if YARP has no format for it."""
    found = (mode, image.dtype, 1 if image.ndim == 2 else image.shape[2])
    name = next((name for name, known in _FORMATS.items() if known == found), None)
    if name is None:
        raise CodecError(f"image {mode} {image.dtype}: expected one of {', '.join(_FORMATS)}")
    pixels = np.ascontiguousarray(image).tobytes()
    rows, cols = image.shape[:2]
    layout = (257, 5, image.dtype.itemsize * found[2], len(pixels), 1, 0, cols, rows)
    return _HEADER.pack(*_FIXED, Vocab(name).number, *layout, 12, len(pixels)) + pixels

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Decoding of compressed images, whose header is checked before memory is allocated."""

from __future__ import annotations

import io
import struct
import warnings
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import CodecError

_FORMATS = ("PNG", "JPEG", "PPM", "BMP", "TIFF", "WEBP")
#: Largest image: 64 million pixels of 3 bytes are 200 MB.
_MAX_PIXELS = 1 << 26
_PNG_MAGIC = b"\x89PNG\r\n\x1a\n"
#: Largest compression of PNG: 1032 bytes of 8 pixels per byte (https://zlib.net/zlib_tech.html).
_PNG_PIXELS_PER_BYTE = 8 * 1032


def decode_image(data: bytes | NDArray[np.uint8], name: str, *, grey: bool = False) -> NDArray[Any]:
    """Return an image: ``(rows, cols)`` if it is grey, otherwise ``(rows, cols, 3)`` as blue, green and red.

    Raises
    ------
    CodecError
        With ``name``, if the data are not an image, or one of more than 67 million pixels.
    """
    import cv2

    _check_size(bytes(data), name)
    try:
        flags = cv2.IMREAD_GRAYSCALE if grey else cv2.IMREAD_UNCHANGED
        image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise CodecError(f"{name}: damaged image: {error}") from error
    if image is None:
        raise CodecError(f"{name}: not an image that can be decoded")
    return np.asarray(image[..., :3] if image.ndim == 3 else image)


def _check_size(data: bytes, name: str) -> None:
    from PIL import Image

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # warnings about sizes, which are checked below
            image = Image.open(io.BytesIO(data), formats=_FORMATS)
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise CodecError(
            f"{name}: not an image that can be decoded ({type(error).__name__}); expected one of "
            f"{', '.join(_FORMATS)}"
        ) from error
    if image.format == "PNG":
        _check_png_chunks(data, name)
    limit = min(_MAX_PIXELS, _PNG_PIXELS_PER_BYTE * len(data) if image.format == "PNG" else _MAX_PIXELS)
    if image.width * image.height > limit:
        raise CodecError(
            f"{name}: {image.width} x {image.height} pixels in {len(data)} bytes, expected at most {limit}"
        )


def _check_png_chunks(data: bytes, name: str) -> None:
    """Refuse a chunk that ends after the file, for whose stated size OpenCV allocates memory."""
    at = len(_PNG_MAGIC)
    while at + 8 <= len(data):
        (size,) = struct.unpack_from(">I", data, at)
        if at + size + 12 > len(data):
            raise CodecError(
                f"{name}: byte {at}: a chunk of {size} bytes in a PNG of {len(data)}; the file is damaged"
            )
        if data[at + 4 : at + 8] == b"IEND":
            return
        at += size + 12

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Images: PNG, PGM, PPM and JPEG, 8 and 16 bits, grey or colour in the order red, green, blue."""

from __future__ import annotations

import io
import re
import struct
import warnings
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.file_source import Readable, Source, load

#: Largest number of pixels of an image: a small file can decompress to any size.
_LARGEST_PIXELS = 1 << 28
_BYTES_PER_PIXEL = {"1": 1, "L": 1, "P": 1, "RGB": 3}
#: Width, height and maximum of a PGM file, after white space and comments; the header is at most this long.
_NETPBM_HEADER = re.compile(rb"P[25]" + 3 * rb"(?:\s|#[^\n]*\n)*(\d+)(?!\d)")
_NETPBM_HEADER_BYTES = 4096
_MODES = {
    "L": np.uint8,
    "RGB": np.uint8,
    "RGBA": np.uint8,
    "I;16": np.uint16,
    "I;16B": np.uint16,
    "I;16L": np.uint16,
}


def read_image(source: Readable) -> NDArray[Any]:
    """Read an image as ``(rows, cols)`` or ``(rows, cols, channels)``, uint8 or uint16.

    Raises
    ------
    CodecError
        With the file name, if it is not a valid PNG, PGM, PPM or JPEG, or has more than 2**28 pixels.
    """
    from PIL import Image

    s = load(source)
    if s.data[:2] in (b"P2", b"P5") and _netpbm_header(s.data)[0][2] > 255:
        return _read_wide_pgm(s)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # a limit is checked below
            picture: Image.Image = Image.open(io.BytesIO(s.data), formats=("PNG", "PPM", "JPEG"))
            if picture.width * picture.height > _LARGEST_PIXELS:
                raise s.error(
                    f"{picture.width} x {picture.height} pixels, expected at most {_LARGEST_PIXELS}"
                )
            size = picture.width * picture.height * _BYTES_PER_PIXEL.get(picture.mode, 4)
            s.check_claim(size, f"{picture.width} x {picture.height} pixels")
            picture.load()
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise s.error(f"not a readable PNG, PGM, PPM or JPEG: {error}") from error
    if picture.mode == "I":  # Pillow extends some 16-bit images to 32
        return np.asarray(picture, dtype=np.int64).clip(0, 65535).astype(np.uint16)
    if picture.mode not in _MODES:
        picture = picture.convert(
            "RGBA"
            if "A" in picture.mode or "transparency" in picture.info
            else "RGB"
            if picture.mode == "P"
            else "L"
        )
    return np.array(picture, dtype=_MODES[picture.mode])


def write_png(image: NDArray[Any]) -> bytes:
    """Return a PNG of a uint8 (1, 3 or 4 channels) or uint16 (1 channel) image; raises InputError for
    others.
    """
    from PIL import Image

    a = np.ascontiguousarray(image)
    grey = a.ndim == 2
    fits = (a.dtype == np.uint8 and (grey or (a.ndim == 3 and a.shape[2] in (3, 4)))) or (
        a.dtype == np.uint16 and grey
    )
    if not fits or 0 in a.shape:
        raise InputError(
            f"image of {a.dtype}, shape {a.shape}: expected uint8 grey, RGB or RGBA, or uint16 grey"
        )
    out = io.BytesIO()
    Image.fromarray(a).save(out, format="PNG", compress_level=6)
    return out.getvalue()


def write_jpg(image: NDArray[Any]) -> bytes:
    """Return a JPEG of ``(rows, cols)`` or ``(rows, cols, 3)`` uint8 pixels; lossy, for display only.

    Raises
    ------
    InputError
        For other pixels: JPEG has 8 bits and no transparency.
    """
    from PIL import Image

    a = np.ascontiguousarray(image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image)
    if a.dtype != np.uint8 or 0 in a.shape or not (a.ndim == 2 or (a.ndim == 3 and a.shape[2] == 3)):
        raise InputError(
            f"image {a.shape} {a.dtype} as jpg: expected uint8, grey or of 3 channels; png, tif "
            "and npz support others"
        )
    buffer = io.BytesIO()
    Image.fromarray(a).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()


def _netpbm_header(data: bytes) -> tuple[list[int], int]:
    """Return width, height and maximum of a PGM header, and the start of the pixels; zeros if invalid."""
    header = _NETPBM_HEADER.match(data[:_NETPBM_HEADER_BYTES])
    return ([int(token) for token in header.groups()], header.end() + 1) if header else ([0, 0, 0], 0)


def _read_wide_pgm(s: Source) -> NDArray[np.uint16]:
    """Read a 16-bit PGM without the scaling of Pillow."""
    data = s.data
    (width, height, _), start = _netpbm_header(data)
    pixels = width * height
    if pixels > _LARGEST_PIXELS:
        raise s.error(f"{width} x {height} pixels, expected at most {_LARGEST_PIXELS}")
    try:
        if data[:2] == b"P2":
            flat = np.array(data[start - 1 :].split(), dtype=np.int64).astype(np.uint16)
        else:
            flat = np.frombuffer(data, ">u2", pixels, start).astype(np.uint16)
    except ValueError as error:
        raise s.error(f"pixels end early: {error}") from error
    if flat.size != pixels:
        raise s.error(f"{flat.size} pixels, expected {pixels}")
    return flat.reshape(height, width)


def write_indexed_png(indices: NDArray[np.uint8], palette: NDArray[np.uint8]) -> bytes:
    """Return a PNG of palette indices ``(rows, cols)``; the palette is ``(256, 3)``, index 0 is transparent.

    The file is compressed at the fastest level.
    """
    rows, cols = indices.shape
    if indices.dtype != np.uint8 or palette.shape != (256, 3):
        raise InputError(f"indices {indices.dtype}, palette {palette.shape}: expected uint8 and (256, 3)")
    lines = np.zeros((rows, cols + 1), dtype=np.uint8)  # each starts with its filter, 0 for none
    lines[:, 1:] = indices
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", cols, rows, 8, 3, 0, 0, 0)),
        (b"PLTE", palette.astype(np.uint8).tobytes()),
        (b"tRNS", b"\x00"),
        (b"IDAT", zlib.compress(lines.tobytes(), 1)),
        (b"IEND", b""),
    ]
    chunks = [
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data))
        for name, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)

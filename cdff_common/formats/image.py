# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pictures: PNG, PGM and PPM, 8 and 16 bits, grey or colour in the order red, green, blue."""

from __future__ import annotations

import io
import struct
import warnings
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.formats.source import Readable, Source, load

_LARGEST_PIXELS = 1 << 28
_BYTES_PER_PIXEL = {"1": 1, "L": 1, "P": 1, "RGB": 3}
_MODES = {"L": np.uint8, "RGB": np.uint8, "RGBA": np.uint8, "I;16": np.uint16, "I;16B": np.uint16, "I;16L": np.uint16}


def read_image(source: Readable) -> NDArray[Any]:
    """Read a picture as ``(rows, cols)`` or ``(rows, cols, channels)``, uint8 or uint16.

    Raises
    ------
    CodecError
        Naming the file, if it is no PNG, PGM or PPM, is broken, or has more than 2**28 pixels.
    """
    from PIL import Image

    s = load(source)
    if s.data[:2] in (b"P2", b"P5") and _netpbm_maximum(s.data) > 255:
        return _read_wide_pgm(s)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Image.DecompressionBombWarning)  # the limit below is ours
            picture: Image.Image = Image.open(io.BytesIO(s.data), formats=("PNG", "PPM"))
            if picture.width * picture.height > _LARGEST_PIXELS:
                raise s.error(f"{picture.width} x {picture.height} pixels, expected at most {_LARGEST_PIXELS}")
            size = picture.width * picture.height * _BYTES_PER_PIXEL.get(picture.mode, 4)
            s.check_claim(size, f"{picture.width} x {picture.height} pixels")
            picture.load()
    except (OSError, ValueError, SyntaxError, EOFError, Image.DecompressionBombError) as error:
        raise s.error(f"no readable PNG, PGM or PPM: {error}") from error
    if picture.mode == "I":  # Pillow widens some 16-bit pictures to 32
        return np.asarray(picture, dtype=np.int64).clip(0, 65535).astype(np.uint16)
    if picture.mode not in _MODES:
        picture = picture.convert(
            "RGBA" if "A" in picture.mode or "transparency" in picture.info else "RGB" if picture.mode == "P" else "L"
        )
    return np.array(picture, dtype=_MODES[picture.mode])


def write_png(image: NDArray[Any]) -> bytes:
    """Bytes of a PNG; raises InputError unless the image is uint8 (1, 3 or 4 channels) or uint16 (1 channel)."""
    from PIL import Image

    a = np.ascontiguousarray(image)
    grey = a.ndim == 2
    fits = (a.dtype == np.uint8 and (grey or (a.ndim == 3 and a.shape[2] in (3, 4)))) or (a.dtype == np.uint16 and grey)
    if not fits or 0 in a.shape:
        raise InputError(f"image of {a.dtype}, shape {a.shape}: expected uint8 grey, RGB or RGBA, or uint16 grey")
    out = io.BytesIO()
    Image.fromarray(a).save(out, format="PNG", compress_level=6)
    return out.getvalue()


def write_jpg(image: NDArray[Any]) -> bytes:
    """JPEG bytes of ``(rows, cols)`` or ``(rows, cols, 3)`` uint8, for looking at: small, and not what was measured.

    Raises
    ------
    InputError
        For other pixels: JPEG has 8 bits and no transparency.
    """
    from PIL import Image

    a = np.ascontiguousarray(image[:, :, 0] if image.ndim == 3 and image.shape[2] == 1 else image)
    if a.dtype != np.uint8 or 0 in a.shape or not (a.ndim == 2 or (a.ndim == 3 and a.shape[2] == 3)):
        raise InputError(
            f"image {a.shape} {a.dtype} as jpg: expected uint8, grey or of 3 channels; png, tif and npz hold others"
        )
    buffer = io.BytesIO()
    Image.fromarray(a).save(buffer, "JPEG", quality=90)
    return buffer.getvalue()


def write_netpbm(image: NDArray[Any]) -> bytes:
    """Bytes of a binary PGM (grey) or PPM (RGB), uint8 or uint16 (big-endian, as the format has it)."""
    a = np.ascontiguousarray(image)
    if a.dtype not in (np.uint8, np.uint16) or not (a.ndim == 2 or (a.ndim == 3 and a.shape[2] == 3)):
        raise InputError(f"image of {a.dtype}, shape {a.shape}: expected uint8 or uint16, grey or RGB")
    largest = 255 if a.dtype == np.uint8 else 65535
    head = f"P{5 if a.ndim == 2 else 6}\n{a.shape[1]} {a.shape[0]}\n{largest}\n".encode()
    return head + (a.tobytes() if largest == 255 else a.astype(">u2").tobytes())


def _netpbm_tokens(data: bytes) -> tuple[list[int], int]:
    """Width, height and maximum of a PGM header, and where the pixels begin; an empty list where it is none."""
    tokens: list[int] = []
    position = 2
    while len(tokens) < 3 and position < min(len(data), 4096):
        if data[position : position + 1] == b"#":
            position = max(data.find(b"\n", position), position) + 1
        elif data[position : position + 1].isspace():
            position += 1
        else:
            end = position
            while end < len(data) and data[end : end + 1].isdigit():
                end += 1
            if end == position:
                return [], 0
            tokens.append(int(data[position:end]))
            position = end
    return (tokens, position + 1) if len(tokens) == 3 else ([], 0)


def _netpbm_maximum(data: bytes) -> int:
    tokens, _ = _netpbm_tokens(data)
    return tokens[2] if tokens else 0


def _read_wide_pgm(s: Source) -> NDArray[np.uint16]:
    """A 16-bit PGM: Pillow scales these, we keep the numbers."""
    data = s.data
    (width, height, _), start = _netpbm_tokens(data)
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
    """Bytes of a PNG of indices ``(rows, cols)`` into a palette ``(256, 3)``, index 0 transparent; made to be fast."""
    rows, cols = indices.shape
    if indices.dtype != np.uint8 or palette.shape != (256, 3):
        raise InputError(f"indices {indices.dtype}, palette {palette.shape}: expected uint8 and (256, 3)")
    lines = np.zeros((rows, cols + 1), dtype=np.uint8)  # each begins with its filter, 0 for none
    lines[:, 1:] = indices
    parts = [
        (b"IHDR", struct.pack(">IIBBBBB", cols, rows, 8, 3, 0, 0, 0)), (b"PLTE", palette.astype(np.uint8).tobytes()),
        (b"tRNS", b"\x00"), (b"IDAT", zlib.compress(lines.tobytes(), 1)), (b"IEND", b""),
    ]  # fmt: skip
    chunks = [
        struct.pack(">I", len(data)) + name + data + struct.pack(">I", zlib.crc32(name + data)) for name, data in parts
    ]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)

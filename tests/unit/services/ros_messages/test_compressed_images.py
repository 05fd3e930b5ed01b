# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compressed images with damaged headers are refused before memory is allocated."""

from __future__ import annotations

import struct
import zlib

import cv2
import numpy as np
import pytest

from cdff_common.errors import CodecError
from services.ros_messages.compressed_images import decode_image

IMAGE = np.arange(48, dtype=np.uint8).reshape(6, 8)


def _png() -> bytearray:
    return bytearray(cv2.imencode(".png", IMAGE)[1].tobytes())


@pytest.mark.parametrize("suffix", [".png", ".bmp", ".pgm", ".tiff"])
def test_images_without_loss_keep_their_pixels(suffix: str) -> None:
    np.testing.assert_array_equal(decode_image(cv2.imencode(suffix, IMAGE)[1], "x"), IMAGE)


def test_bytes_after_the_end_of_a_png_are_ignored() -> None:
    np.testing.assert_array_equal(decode_image(bytes(_png() + b"\xff" * 20), "x"), IMAGE)


def test_a_png_with_more_pixels_than_its_bytes_can_hold_is_refused() -> None:
    data = _png()
    data[16:24] = struct.pack(">II", 8000, 8000)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    with pytest.raises(CodecError, match=r"x\.png: 8000 x 8000 pixels in \d+ bytes, expected at most"):
        decode_image(bytes(data), "x.png")


def test_a_png_with_a_chunk_beyond_its_end_is_refused() -> None:
    data = _png()
    data[33:37] = struct.pack(">I", 700 << 20)
    with pytest.raises(CodecError, match=r"x\.png: byte 33: a chunk of 734003200 bytes"):
        decode_image(bytes(data), "x.png")

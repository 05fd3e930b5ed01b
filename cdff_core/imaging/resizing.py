# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Smaller images by whole blocks, with the camera matrix that fits them."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np

from cdff_common.errors import InputError
from cdff_common.types import Frame
from cdff_core.imaging.frames import with_image


def shrunk(frame: Frame, columns: int, rows: int) -> Frame:
    """Every block of ``columns`` x ``rows`` pixels as their mean; what is left over at right and bottom is cut off.

    Pixel centres lie on whole numbers: the new pixel 0 has its centre at ``(columns - 1) / 2`` of the old ones.
    Distortion is in units of the focal length and stays. Raises InputError where the image is smaller than a block.
    """
    image = frame.image
    height, width = image.shape[0] // rows, image.shape[1] // columns
    if not height or not width:
        raise InputError(f"image of {image.shape[0]} x {image.shape[1]} pixels: expected at least {rows} x {columns}")
    cut = np.ascontiguousarray(image[: height * rows, : width * columns])
    small = with_image(frame, cv2.resize(cut, (width, height), interpolation=cv2.INTER_AREA))
    # Old pixel coordinates to new ones, for the focal lengths and for the principal point.
    to_new = np.array(
        [
            [1.0 / columns, 0.0, (1.0 / columns - 1.0) / 2.0],
            [0.0, 1.0 / rows, (1.0 / rows - 1.0) / 2.0],
            [0.0, 0.0, 1.0],
        ]
    )
    K = frame.camera_matrix
    return replace(small, intrinsic=replace(small.intrinsic, camera_matrix=to_new @ K if K.any() else K))

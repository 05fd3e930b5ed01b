# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Reduction of images by averaging blocks of pixels, with the camera matrix of the result."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_common.types import Frame
from cdff_core.imaging.frames import with_image


class BlockConfig(DfnConfig):
    """Size of the averaged blocks."""

    columns_per_pixel: int = Field(2, ge=1, le=64, description="Columns averaged into one, px")
    rows_per_pixel: int = Field(2, ge=1, le=64, description="Rows averaged into one, px")


def reduce_image(frame: Frame, block: BlockConfig) -> Frame:
    """Return the image of the means of all blocks of pixels; incomplete blocks are cut off.

    Pixel centres have whole coordinates: the centre of the new pixel 0 is at ``(columns - 1) / 2`` in old
    coordinates. Distortion coefficients are in units of the focal length and therefore unchanged. Raises
    InputError if the image is smaller than a block.
    """
    image, columns, rows = frame.image, block.columns_per_pixel, block.rows_per_pixel
    height, width = image.shape[0] // rows, image.shape[1] // columns
    if not height or not width:
        raise InputError(
            f"image of {image.shape[0]} x {image.shape[1]} pixels: expected at least {rows} x {columns}"
        )
    cropped = np.ascontiguousarray(image[: height * rows, : width * columns])
    reduced = with_image(frame, cv2.resize(cropped, (width, height), interpolation=cv2.INTER_AREA))
    # Transform from old to new pixel coordinates.
    to_new = np.array(
        [
            [1.0 / columns, 0.0, (1.0 / columns - 1.0) / 2.0],
            [0.0, 1.0 / rows, (1.0 / rows - 1.0) / 2.0],
            [0.0, 0.0, 1.0],
        ]
    )
    K = frame.camera_matrix
    return replace(reduced, intrinsic=replace(reduced.intrinsic, camera_matrix=to_new @ K if K.any() else K))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check that a calibration belongs to the images with which it is used."""

from __future__ import annotations

from cdff_common.camera.model import CameraModel
from cdff_common.errors import InputError

#: Largest distance of the principal point from the middle of the image, in widths and heights of the image.
_MAX_DECENTRING = 0.2
#: Focal lengths in widths of the image: fields of view from 136 to 6 degrees.
_MIN_FOCAL_WIDTHS, _MAX_FOCAL_WIDTHS = 0.2, 10.0


def check_image_size(camera: CameraModel, rows: int, cols: int, source: str) -> None:
    """Raise InputError if a calibration does not fit images of a size.

    The size must be that of the calibration. If the calibration has none, the principal point must be within
    20 % of the size from the middle of the image, and the focal length between 0.2 and 10 widths.

    Parameters
    ----------
    camera : CameraModel
    rows, cols : int
        Size of the images, pixels.
    source : str
        Name of the calibration file.
    """
    if camera.rows and camera.cols:
        if (camera.rows, camera.cols) != (rows, cols):
            raise InputError(
                f"{source}: for {camera.cols} x {camera.rows} pixels, the image has {cols} x {rows}: "
                "expected an image of the calibrated size"
            )
        return
    offsets = abs(camera.cx / cols - 0.5), abs(camera.cy / rows - 0.5)
    if max(offsets) > _MAX_DECENTRING:
        raise InputError(
            f"{source}: principal point {camera.cx:.1f}, {camera.cy:.1f} in images of {cols} x {rows} "
            f"pixels: expected within {_MAX_DECENTRING:.0%} of the size from the middle; the calibration is "
            "of another camera or image size"
        )
    if not _MIN_FOCAL_WIDTHS <= camera.fx / cols <= _MAX_FOCAL_WIDTHS:
        raise InputError(
            f"{source}: focal length {camera.fx:.1f} in images of {cols} x {rows} pixels: expected "
            f"{_MIN_FOCAL_WIDTHS * cols:.0f} to {_MAX_FOCAL_WIDTHS * cols:.0f}; the calibration is of "
            "another camera or image size"
        )

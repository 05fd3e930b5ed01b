# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Check that the left image of a stereo pair is that of the left camera."""

from __future__ import annotations

from typing import Any

import numpy as np

from cdff_common.arrays import ByteArray, FloatArray
from cdff_common.errors import RefusedError
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.stereo_matching_2d.interface import StereoMatching2DInputs, StereoMatching2DOutputs

StereoMatchingDfn = Dfn[Any, StereoMatching2DInputs, StereoMatching2DOutputs]
#: Number of features that are matched, and least number of matches that show an order.
_FEATURES, _MIN_MATCHES = 150, 20
#: Ratio of the numbers of matches in the wrong and in the right order above which the cameras are swapped.
_RATIO = 3.0


def check_camera_order(
    left: ByteArray, right: ByteArray, pixels: FloatArray, match: StereoMatchingDfn
) -> None:
    """Raise RefusedError ``cameras_swapped`` if points of the left image lie further right in the right one.

    Nothing is raised if the images show no order, such as a black right image.

    Parameters
    ----------
    left, right : ndarray of uint8, shape (rows, columns)
        Rectified images.
    pixels : ndarray, shape (n, 2)
        Features of the left image: column and row.
    """
    if left.shape != right.shape or not len(pixels):
        return
    chosen = np.ascontiguousarray(pixels[:: max(1, len(pixels) // _FEATURES)])
    in_order = _matches(match, left, right, chosen)
    if in_order >= len(chosen) // 2:
        return
    mirrored = np.column_stack([left.shape[1] - 1.0 - chosen[:, 0], chosen[:, 1]])
    swapped = _matches(
        match, np.ascontiguousarray(left[:, ::-1]), np.ascontiguousarray(right[:, ::-1]), mirrored
    )
    if swapped >= max(_MIN_MATCHES, _RATIO * in_order):
        raise RefusedError(
            f"swapped cameras: {swapped} points lie further right in the right image, {in_order} left",
            [f"cameras_swapped:{swapped}>{in_order}"],
        )


def _matches(match: StereoMatchingDfn, left: ByteArray, right: ByteArray, pixels: FloatArray) -> int:
    """Return the number of features with a disparity of more than a pixel."""
    result = match.process(StereoMatching2DInputs(left=left, right=right, features=pixels))
    return int((result.valid & (np.where(result.valid, result.disparities, 0.0) > 1.0)).sum())

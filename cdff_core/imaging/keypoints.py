# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of OpenCV keypoints to arrays and back; the octave follows from the size."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numba import njit

from cdff_common.arrays import ByteArray, FloatArray, IntArray

#: Scale factor, levels and patch size of ORB; initial smoothing and layers per octave of SIFT.
ORB_SCALE, ORB_LEVELS, ORB_PATCH_PX = 1.2, 8, 31.0
_SIFT_SIGMA_PX, _SIFT_LAYERS = 1.6, 3


def arrays_of(points: Sequence[cv2.KeyPoint]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return positions ``(n, 2)``, responses, diameters (pixels), angles (degrees, clockwise from x)."""
    table = np.array([(*p.pt, p.response, p.size, p.angle) for p in points], np.float64).reshape(-1, 5)
    return table[:, :2].copy(), table[:, 2].copy(), table[:, 3].copy(), table[:, 4].copy()


def sift_keypoints(points: FloatArray, sizes: FloatArray, angles: FloatArray) -> list[cv2.KeyPoint]:
    """Return the keypoints at which SIFT computes descriptors, numbered by ``class_id``.

    OpenCV reads the octave from the low byte of the octave field and the layer from the next byte. The last
    layer of an octave is the first one of the next, where a descriptor has a quarter of the pixels. The image
    is not doubled for the smallest points, which takes longer than their descriptors.
    """
    ratio = np.maximum(sizes, 1e-3) / (2.0 * _SIFT_SIGMA_PX)
    step = np.maximum(np.rint(_SIFT_LAYERS * np.log2(ratio)).astype(np.int64), 0)
    octave, layer = step // _SIFT_LAYERS, step % _SIFT_LAYERS
    return _keypoints(points, sizes, angles, (octave & 255) | (layer << 8))


def orb_keypoints(points: FloatArray, sizes: FloatArray, angles: FloatArray) -> list[cv2.KeyPoint]:
    """Return the keypoints at which ORB computes descriptors, numbered by ``class_id``."""
    ratio = np.maximum(sizes, ORB_PATCH_PX) / ORB_PATCH_PX
    level = np.rint(np.log(ratio) / np.log(ORB_SCALE)).astype(np.int64)
    return _keypoints(points, sizes, angles, np.clip(level, 0, ORB_LEVELS - 1))


def _keypoints(
    points: FloatArray, sizes: FloatArray, angles: FloatArray, octaves: IntArray
) -> list[cv2.KeyPoint]:
    columns = (*points.T, sizes, angles, np.zeros(len(points)), octaves, np.arange(len(points)))
    return [cv2.KeyPoint(*row) for row in zip(*(column.tolist() for column in columns), strict=True)]


def centroid_angles(image: ByteArray, points: FloatArray, radius_px: int = 10) -> FloatArray:
    """Return the direction from each point to the grey-value centroid around it, degrees clockwise from x.

    Rosin (1999), doi:10.1006/cviu.1998.0719; beyond the border, the edge pixels are repeated.
    """
    pixels = np.rint(points).astype(np.int64)
    read_only = np.ascontiguousarray(image).view()
    read_only.flags.writeable = False  # the kernel is compiled for one type of array only
    x, y = _moments(read_only, pixels, radius_px).T
    return np.asarray(np.degrees(np.arctan2(y, x)) % 360.0)


def compile_kernel() -> None:
    """Compile the kernel of ``centroid_angles``."""
    centroid_angles(np.zeros((1, 1), np.uint8), np.zeros((1, 2)))


@njit(cache=True)
def _moments(image: ByteArray, pixels: IntArray, radius_px: int) -> IntArray:  # pragma: no cover
    """Return the sums of grey values times their offsets x and y from each pixel ``(n, 2)``, over a disc."""
    rows, columns = image.shape
    sums = np.zeros((len(pixels), 2), np.int64)
    half_widths = np.zeros(2 * radius_px + 1, np.int64)
    for y in range(-radius_px, radius_px + 1):
        half_widths[y + radius_px] = int(math.sqrt(radius_px**2 - y**2))
    for i in range(len(pixels)):
        for y in range(-radius_px, radius_px + 1):
            row, half_width = min(max(pixels[i, 1] + y, 0), rows - 1), half_widths[y + radius_px]
            grey_sum = np.int64(0)
            for x in range(-half_width, half_width + 1):
                grey = np.int64(image[row, min(max(pixels[i, 0] + x, 0), columns - 1)])
                grey_sum += grey
                sums[i, 0] += grey * x
            sums[i, 1] += grey_sum * y
    return sums

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Conversion of OpenCV keypoints to arrays and back; the octave follows from the size."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from cdff_common.arrays import ByteArray, FloatArray, IntArray

#: Scale factor, levels and patch of ORB, and initial smoothing and layers of the pyramid of SIFT.
ORB_SCALE, ORB_LEVELS, ORB_PATCH_PX = 1.2, 8, 31.0
_SIFT_SIGMA_PX, _SIFT_LAYERS = 1.6, 3


def arrays_of(points: Sequence[cv2.KeyPoint]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return positions ``(n, 2)``, responses, diameters (pixels), angles (degrees, clockwise from x)."""
    table = np.array([(*p.pt, p.response, p.size, p.angle) for p in points], np.float64).reshape(-1, 5)
    return table[:, :2].copy(), table[:, 2].copy(), table[:, 3].copy(), table[:, 4].copy()


def sift_keypoints(points: FloatArray, sizes: FloatArray, angles: FloatArray) -> list[cv2.KeyPoint]:
    """Return the keypoints at which SIFT computes descriptors, numbered by ``class_id``.

    OpenCV reads the octave from the low byte of the octave field and the layer from the next byte. The image
    is not doubled for the smallest points, which takes longer than their descriptors.
    """
    ratio = np.maximum(sizes, 1e-3) / (2.0 * _SIFT_SIGMA_PX)
    step = np.rint(_SIFT_LAYERS * np.log2(ratio)).astype(np.int64)
    octave = np.maximum((step - 1) // _SIFT_LAYERS, 0)
    layer = np.clip(step - _SIFT_LAYERS * octave, 1, _SIFT_LAYERS)
    return _keypoints(points, sizes, angles, (octave & 255) | (layer << 8))


def orb_keypoints(points: FloatArray, sizes: FloatArray, angles: FloatArray) -> list[cv2.KeyPoint]:
    """Return the keypoints at which ORB computes descriptors, numbered by ``class_id``."""
    ratio = np.maximum(sizes, ORB_PATCH_PX) / ORB_PATCH_PX
    level = np.rint(np.log(ratio) / np.log(ORB_SCALE)).astype(np.int64)
    return _keypoints(points, sizes, angles, np.clip(level, 0, ORB_LEVELS - 1))


def _keypoints(
    points: FloatArray, sizes: FloatArray, angles: FloatArray, octaves: IntArray
) -> list[cv2.KeyPoint]:
    rows = zip(points.tolist(), sizes, angles, octaves.tolist(), strict=True)
    return [
        cv2.KeyPoint(x, y, size, angle, 0.0, octave, i)
        for i, ((x, y), size, angle, octave) in enumerate(rows)
    ]


def centroid_angles(image: ByteArray, points: FloatArray, radius_px: int = 10) -> FloatArray:
    """Return the direction from each point to the grey-value centroid around it, degrees clockwise from x.

    Rosin (1999), doi:10.1006/cviu.1998.0719; beyond the border, the edge pixels are repeated.
    """
    y, x = np.mgrid[-radius_px : radius_px + 1, -radius_px : radius_px + 1].astype(np.int64)
    disc = x**2 + y**2 <= radius_px**2
    x, y = x[disc], y[disc]
    columns = np.clip(np.rint(points[:, 0]).astype(np.int64)[:, None] + x, 0, image.shape[1] - 1)
    rows = np.clip(np.rint(points[:, 1]).astype(np.int64)[:, None] + y, 0, image.shape[0] - 1)
    patch = image[rows, columns].astype(np.float64)
    return np.asarray(np.degrees(np.arctan2(patch @ y, patch @ x)) % 360.0)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""OpenCV's key points as arrays and back: position, size and angle say all; the octave follows from the size."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

#: Scale steps and patch of ORB, and the smoothing that SIFT's pyramid begins with.
ORB_SCALE, ORB_LEVELS, ORB_PATCH_PX = 1.2, 8, 31.0
_SIFT_SIGMA_PX = 1.6


def arrays_of(points: Sequence[cv2.KeyPoint]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Positions ``(n, 2)``, responses, sizes (diameters, pixels) and angles (degrees, clockwise from x) ``(n,)``."""
    table = np.array([(*p.pt, p.response, p.size, p.angle) for p in points], np.float64).reshape(-1, 5)
    return table[:, :2].copy(), table[:, 2].copy(), table[:, 3].copy(), table[:, 4].copy()


def sift_keypoints(points: FloatArray, sizes: FloatArray, angles: FloatArray, layers: int = 3) -> list[cv2.KeyPoint]:
    """Key points at which SIFT computes descriptors, numbered by ``class_id``.

    OpenCV finds a key point's place in its pyramid from a packed octave: octave in the low byte, layer in the next.
    """
    step = np.rint(layers * np.log2(np.maximum(sizes, 1e-3) / (2.0 * _SIFT_SIGMA_PX))).astype(np.int64)
    octave = np.maximum((step - 1) // layers, -1)
    layer = np.clip(step - layers * octave, 1, layers)
    packed = (octave & 255) | (layer << 8)
    return [
        cv2.KeyPoint(x, y, size, angle, 0.0, int(where), i)
        for i, ((x, y), size, angle, where) in enumerate(zip(points.tolist(), sizes, angles, packed, strict=True))
    ]


def orb_keypoints(points: FloatArray, sizes: FloatArray, angles: FloatArray) -> list[cv2.KeyPoint]:
    """Key points at which ORB computes descriptors, numbered by ``class_id``."""
    level = np.rint(np.log(np.maximum(sizes, ORB_PATCH_PX) / ORB_PATCH_PX) / np.log(ORB_SCALE)).astype(np.int64)
    level = np.clip(level, 0, ORB_LEVELS - 1)
    return [
        cv2.KeyPoint(x, y, size, angle, 0.0, int(where), i)
        for i, ((x, y), size, angle, where) in enumerate(zip(points.tolist(), sizes, angles, level, strict=True))
    ]


def centroid_angles(image: NDArray[np.uint8], points: FloatArray, radius_px: int = 10) -> FloatArray:
    """Direction from each point to the centroid of the grey values around it, degrees clockwise from x.

    Rosin (1999), doi:10.1006/cviu.1998.0719; at the rim of the image its edge is repeated.
    """
    y, x = np.mgrid[-radius_px : radius_px + 1, -radius_px : radius_px + 1].astype(np.int64)
    disc = x**2 + y**2 <= radius_px**2
    x, y = x[disc], y[disc]
    columns = np.clip(np.rint(points[:, 0]).astype(np.int64)[:, None] + x, 0, image.shape[1] - 1)
    rows = np.clip(np.rint(points[:, 1]).astype(np.int64)[:, None] + y, 0, image.shape[0] - 1)
    patch = image[rows, columns].astype(np.float64)
    return np.asarray(np.degrees(np.arctan2(patch @ y, patch @ x)) % 360.0)

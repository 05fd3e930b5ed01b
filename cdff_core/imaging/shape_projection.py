# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Silhouettes of convex shapes in the image of a pinhole camera."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, FloatArray

#: Distance of the plane at which shapes are cut, metres in front of the camera.
_NEAR_M = 0.02
#: Largest pixel coordinate, which OpenCV's fixed-point polygons can represent.
_LARGEST_PX = 1e6


def silhouettes(
    shapes_m: Iterable[FloatArray], camera_matrix: FloatArray, shape: tuple[int, int]
) -> BoolArray:
    """Return the pixels (rows, cols) that show one of the shapes.

    Parameters
    ----------
    shapes_m : iterable of FloatArray, shape (n, 3)
        Points in the frame of the camera (x right, y down, z forward); each shape is their convex hull.
    camera_matrix : FloatArray, shape (3, 3)
    shape : tuple of int
        Rows and columns of the image.
    """
    image = np.zeros(shape, np.uint8)
    for points in shapes_m:
        clipped = _in_front(points)
        if len(clipped) >= 3:
            pixels = clipped / clipped[:, 2:] @ camera_matrix.T
            hull = cv2.convexHull(np.clip(pixels[:, :2], -_LARGEST_PX, _LARGEST_PX).astype(np.float32))
            cv2.fillConvexPoly(image, np.rint(hull).astype(np.int32), 255)
    return np.asarray(image > 0)


def _in_front(points: FloatArray) -> FloatArray:
    """Return points whose hull is the part of the hull of ``points`` in front of the camera.

    The segments between any point in front and any point behind the plane contain all cut edges.
    """
    is_front = points[:, 2] >= _NEAR_M
    front, behind = points[is_front], points[~is_front]
    if not len(front) or not len(behind):
        return front
    fraction = (front[:, None, 2] - _NEAR_M) / (front[:, None, 2] - behind[None, :, 2])
    cuts = front[:, None] + fraction[..., None] * (behind[None] - front[:, None])
    return np.concatenate([front, cuts.reshape(-1, 3)])

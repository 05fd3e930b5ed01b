# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Silhouettes of convex shapes in the images of a pinhole camera."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, FloatArray

#: Distance in front of the camera, metres, of the plane at which shapes are cut.
_NEAR_M = 0.02
#: Largest pixel coordinate; OpenCV's fixed-point polygons can represent it.
_LARGEST_PX = 1e6


def silhouettes(
    shapes_m: Iterable[FloatArray], camera_matrix: FloatArray, shape: tuple[int, int]
) -> BoolArray:
    """Return a mask of bool, shape (rows, columns), that is True where a shape covers the pixel.

    Parameters
    ----------
    shapes_m : iterable of FloatArray, shape (n, 3)
        Points in the frame of the camera (x right, y down, z forward), metres; a shape is the convex hull of
        its points.
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
    """Return points (m, 3) whose hull is the part of the hull of ``points`` (n, 3) in front of the camera.

    All segments between a point in front of the plane and a point behind it are cut; the edges of the hull
    are among them.
    """
    is_front = points[:, 2] >= _NEAR_M
    front, behind = points[is_front], points[~is_front]
    if not len(front) or not len(behind):
        return front
    fraction = (front[:, None, 2] - _NEAR_M) / (front[:, None, 2] - behind[None, :, 2])
    cuts = front[:, None] + fraction[..., None] * (behind[None] - front[:, None])
    return np.concatenate([front, cuts.reshape(-1, 3)])

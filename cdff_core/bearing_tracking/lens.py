# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of focal length and radial distortion of a camera, applied to directions."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray


def undistort_directions(directions: FloatArray, scale: float, radial: float) -> FloatArray:
    """Return unit vectors (n, 3) for a focal length ``scale`` times the given one and a radial distortion.

    The tangents x / z, y / z are multiplied with ``1 / scale + radial r^2``.
    """
    if scale == 1.0 and radial == 0.0:
        return directions
    with np.errstate(invalid="ignore", divide="ignore"):
        xy = directions[:, :2] / directions[:, 2:]
        r2 = (xy**2).sum(axis=1, keepdims=True)
        result = np.column_stack([xy * (1.0 / scale + radial * r2), np.ones(len(xy))])
    result[directions[:, 2] < 0.0] *= -1.0  # behind the camera
    return np.asarray(result / np.linalg.norm(result, axis=1, keepdims=True))


def distort_directions(directions: FloatArray, scale: float, radial: float) -> FloatArray:
    """Return the inverse of ``undistort_directions``, by fixed-point iteration."""
    if scale == 1.0 and radial == 0.0:
        return directions
    with np.errstate(invalid="ignore", divide="ignore"):
        xy = directions[:, :2] / directions[:, 2:]
        result = xy * scale
        for _ in range(4):
            result = xy / (1.0 / scale + radial * (result**2).sum(axis=1, keepdims=True))
        vectors = np.column_stack([result, np.ones(len(xy))])
    vectors[directions[:, 2] < 0.0] *= -1.0
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))

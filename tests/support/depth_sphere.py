# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Depth images of a sphere at the origin, seen by cameras around it."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3

RADIUS_M, DISTANCE_M = 0.5, 2.0
ROWS, COLUMNS, FOCAL_PX = 60, 80, 90.0
K = np.array([[FOCAL_PX, 0.0, 40.0], [0.0, FOCAL_PX, 30.0], [0.0, 0.0, 1.0]])


def camera_poses(count: int, first_rad: float = 0.0) -> FloatArray:
    """Return poses T_sphere_camera on a spiral around the sphere, looking at its middle."""
    fractions = (np.arange(count) + 0.5) / count
    heights, angles = 1.0 - 2.0 * fractions, first_rad + 2.4 * np.arange(count)
    radii = np.sqrt(1.0 - heights**2)
    backwards = np.stack([radii * np.cos(angles), radii * np.sin(angles), heights], axis=1)
    x = np.cross(backwards, np.roll(backwards, 1, axis=1))
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    R = np.stack([x, np.cross(-backwards, x), -backwards], axis=2)
    return np.asarray(se3.transform(R, DISTANCE_M * backwards))


def depth_image() -> FloatArray:
    """Return the depths from any of the cameras, 0 where there is no sphere."""
    u, v = np.meshgrid((np.arange(COLUMNS) - K[0, 2]) / FOCAL_PX, (np.arange(ROWS) - K[1, 2]) / FOCAL_PX)
    squared = u**2 + v**2 + 1.0
    root = DISTANCE_M**2 - squared * (DISTANCE_M**2 - RADIUS_M**2)
    return np.where(root > 0.0, (DISTANCE_M - np.sqrt(np.maximum(root, 0.0))) / squared, 0.0)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Views on a model from all sides."""

from __future__ import annotations

import math

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import se3
from cdff_core.object_models.rendering import Window

#: Distance of the viewpoints, in diameters of the model.
_DISTANCE = 4.0


def directions(count: int) -> FloatArray:
    """Return unit vectors (count, 3) that are evenly spread on the sphere: the Fibonacci lattice.

    González (2010), doi:10.1007/s11004-009-9257-x.
    """
    i = np.arange(count) + 0.5
    z = 1.0 - 2.0 * i / count
    azimuth = math.pi * (1.0 + math.sqrt(5.0)) * i
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(azimuth), radius * np.sin(azimuth), z], axis=1)


def view_rotation(direction: FloatArray) -> FloatArray:
    """Return R_camera_model (3, 3) of a camera that looks at the model from ``direction`` (3,)."""
    z = -direction / np.linalg.norm(direction)
    x = np.cross([0.0, 0.0, 1.0] if abs(z[2]) < 0.9 else [1.0, 0.0, 0.0], z)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z])


def view_poses(centre_m: FloatArray, radius_m: float, count: int) -> FloatArray:
    """Return T_camera_model (count, 4, 4) of cameras around a model with a centre (3,) and a radius."""
    poses = np.empty((count, 4, 4))
    for pose, direction in zip(poses, directions(count), strict=True):
        R = view_rotation(direction)
        pose[:] = se3.transform(R, [0.0, 0.0, 2.0 * _DISTANCE * radius_m] - R @ centre_m)
    return poses


def view_window(pixels: int) -> Window:
    """Return the square window in which a model at the distance of ``view_poses`` fits."""
    tangent = 1.0 / math.sqrt((2.0 * _DISTANCE) ** 2 - 1.0)
    focal = 0.5 * (pixels - 2) / tangent
    centre = 0.5 * (pixels - 1)
    return Window(focal, focal, centre, centre, pixels, pixels)

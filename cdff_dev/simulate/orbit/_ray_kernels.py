# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled loops over rays: from sensor axes to body axes, and from a cast to visible points."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Float = NDArray[np.float64]
Single = NDArray[np.float32]
Index = NDArray[np.intp]


@njit(cache=True, nogil=True)
def place_rays(
    directions: Single, chosen: Index, of_pose: Index, R_body_sensor: Float, origins: Float, skipped: Float
) -> Single:  # pragma: no cover - compiled
    """Return rays (k, 6) of chosen directions (n, 3), rotated by ``R_body_sensor`` (p, 3, 3).

    They start at the origins (p, 3), advanced by ``skipped`` (p,) along the ray; ``of_pose`` (n,) holds the
    index of the rotation, origin and advance of each direction.
    """
    rays = np.empty((len(chosen), 6), np.float32)
    for k in range(len(chosen)):
        i = chosen[k]
        pose = of_pose[i]
        x, y, z = np.float64(directions[i, 0]), np.float64(directions[i, 1]), np.float64(directions[i, 2])
        for axis in range(3):
            d = (
                R_body_sensor[pose, axis, 0] * x
                + R_body_sensor[pose, axis, 1] * y
                + R_body_sensor[pose, axis, 2] * z
            )
            rays[k, 3 + axis] = np.float32(d)
            rays[k, axis] = np.float32(origins[pose, axis] + skipped[pose] * d)
    return rays


@njit(cache=True, nogil=True)
def visible_points(
    rays: Single,
    distance: Single,
    primitive: NDArray[np.uint32],
    normals: Single,
    material_of: Index,
) -> tuple[Index, Single, Single, Single, Single, Index]:  # pragma: no cover - compiled
    """Return index, distance, point, normal, direction to the eye, and material of the rays (n, 6) that hit.

    The normals are flipped where necessary, so that they face the eye.
    """
    count = 0
    for i in range(len(distance)):
        if distance[i] != np.inf:
            count += 1
    index = np.empty(count, np.intp)
    length = np.empty(count, np.float32)
    points = np.empty((count, 3), np.float32)
    facing_normals = np.empty((count, 3), np.float32)
    to_eye = np.empty((count, 3), np.float32)
    material = np.empty(count, np.intp)
    k = 0
    for i in range(len(distance)):
        if distance[i] == np.inf:
            continue
        along = np.float32(0.0)
        for axis in range(3):
            along += normals[i, axis] * rays[i, 3 + axis]
        side = np.float32(-1.0) if along > 0.0 else np.float32(1.0)
        for axis in range(3):
            points[k, axis] = rays[i, axis] + distance[i] * rays[i, 3 + axis]
            facing_normals[k, axis] = side * normals[i, axis]
            to_eye[k, axis] = -rays[i, 3 + axis]
        index[k], length[k], material[k] = i, distance[i], material_of[primitive[i]]
        k += 1
    return index, length, points, facing_normals, to_eye, material

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pixels of a reference image warped into a current image: residuals and derivatives, compiled by numba."""

from __future__ import annotations

import numba as nb
import numpy as np

_MIN_DEPTH_M = 0.05


@nb.njit(cache=True, inline="always")
def _bilinear(image, x, y):  # type: ignore[no-untyped-def]
    column, row = int(x), int(y)
    a, b = x - column, y - row
    top = (1.0 - a) * image[row, column] + a * image[row, column + 1]
    bottom = (1.0 - a) * image[row + 1, column] + a * image[row + 1, column + 1]
    return (1.0 - b) * top + b * bottom


@nb.njit(cache=True)
def warp_pixels(image, usable, values, points, disparity, pose, camera, shift_m, field):  # type: ignore[no-untyped-def]
    """Return residuals of pixels, with derivatives by the pose, by the disparity and by the position.

    Parameters
    ----------
    image : Float32Array, shape (rows, cols)
        Current image of the left or the right camera.
    usable : BoolArray, shape (rows, cols)
    values : FloatArray, shape (n,)
        Grey levels in the reference.
    points : FloatArray, shape (n, 3)
        Points in the left camera of the reference, metres.
    disparity : FloatArray, shape (n,)
        Their disparities, pixels of the full resolution.
    pose : FloatArray, shape (4, 4)
        ``T_current_reference`` of the left camera.
    camera : FloatArray, shape (4,)
        ``fx, fy, cx, cy`` of this level, pixels.
    shift_m : float
        Column of the camera in the left camera: 0 for the left one, the baseline for the right one.
    field : FloatArray, shape (2,)
        Displacement of the columns, pixels of this level: constant, and per squared distance from the
        principal point in normalised coordinates.

    Returns
    -------
    residuals : FloatArray, shape (n,)
        Current minus reference grey level; 0 outside the image.
    by_pose : FloatArray, shape (n, 6)
        Derivatives by ``[x y z rx ry rz]``, perturbation in the current frame: ``p + t + r x (p - t_pose)``.
    by_disparity : FloatArray, shape (n,)
    gradients : FloatArray, shape (n, 2)
        Derivatives by column and row of the current image.
    positions : FloatArray, shape (n, 2)
        Columns and rows in the current image, pixels.
    visible : BoolArray, shape (n,)
    """
    n = len(points)
    residuals, by_pose, by_disparity = np.zeros(n), np.zeros((n, 6)), np.zeros(n)
    gradients, positions, visible = np.zeros((n, 2)), np.zeros((n, 2)), np.zeros(n, np.bool_)
    rows, cols = image.shape
    fx, fy, cx, cy = camera[0], camera[1], camera[2], camera[3]
    for i in range(n):
        px, py, pz = points[i, 0], points[i, 1], points[i, 2]
        rx = pose[0, 0] * px + pose[0, 1] * py + pose[0, 2] * pz
        ry = pose[1, 0] * px + pose[1, 1] * py + pose[1, 2] * pz
        rz = pose[2, 0] * px + pose[2, 1] * py + pose[2, 2] * pz
        x, y, z = rx + pose[0, 3] - shift_m, ry + pose[1, 3], rz + pose[2, 3]
        if z < _MIN_DEPTH_M:
            continue
        u, v = fx * x / z + cx, fy * y / z + cy
        u += field[0] + field[1] * (x * x + y * y) / (z * z)
        positions[i, 0], positions[i, 1] = u, v
        if not (2.0 <= u < cols - 3.0 and 2.0 <= v < rows - 3.0):
            continue
        if not usable[int(v + 0.5), int(u + 0.5)]:
            continue
        gx = 0.5 * (_bilinear(image, u + 1.0, v) - _bilinear(image, u - 1.0, v))
        gy = 0.5 * (_bilinear(image, u, v + 1.0) - _bilinear(image, u, v - 1.0))
        ax, ay = gx * fx / z, gy * fy / z
        az = -(ax * x + ay * y) / z
        visible[i] = True
        residuals[i] = _bilinear(image, u, v) - values[i]
        gradients[i, 0], gradients[i, 1] = gx, gy
        by_pose[i, 0], by_pose[i, 1], by_pose[i, 2] = ax, ay, az
        by_pose[i, 3] = az * ry - ay * rz
        by_pose[i, 4] = ax * rz - az * rx
        by_pose[i, 5] = ay * rx - ax * ry
        by_disparity[i] = -(ax * rx + ay * ry + az * rz) / disparity[i]
    return residuals, by_pose, by_disparity, gradients, positions, visible

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Point-to-plane registration of a scan to the surface of a model, from many starts at once."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.small_vectors import cross, inverse_transformed, inverse_translation
from cdff_core.object_models.nearest_grid import NearestGrid, nearest_row

#: Weight of the distance along the surface relative to the distance across it: it keeps poses from moving
#: along directions that the planes leave unconstrained.
_ALONG_SURFACE = 0.05
#: Damping, relative to the mean diagonal of the normal equations.
_DAMPING = 1e-6


def register(
    poses: FloatArray,
    scan_m: FloatArray,
    points_m: FloatArray,
    normals: FloatArray,
    grid: NearestGrid,
    scales_m: FloatArray,
    *,
    one_sided: bool = True,
) -> tuple[FloatArray, FloatArray]:
    """Return poses (k, 4, 4) after one Gauss-Newton step per scale, and their costs (k,).

    Point-to-plane distances (Chen and Medioni 1992, doi:10.1016/0262-8856(92)90066-C) with Tukey's weights.

    Parameters
    ----------
    poses : ndarray, shape (k, 4, 4)
        Starts: T_sensor_model.
    scan_m : ndarray, shape (n, 3)
        Points of the scan; the sensor is at the origin.
    points_m, normals, grid
        Surface of the model and the grid of its points.
    scales_m : ndarray, shape (i,)
        Distance from which a point has no weight, for each iteration.
    one_sided : bool
        Ignore pairs whose surface faces away from the sensor.

    Returns
    -------
    poses : ndarray, shape (k, 4, 4)
    costs : ndarray, shape (k,)
        Mean of the squared distances, which the last scale limits, divided by its square: 0 to 1.
    """
    out = np.array(poses, np.float64)
    costs = np.empty(len(out))
    _register(
        out,
        np.ascontiguousarray(scan_m, np.float64),
        points_m,
        normals,
        grid,
        np.asarray(scales_m, np.float64),
        one_sided,
        costs,
    )
    return out, costs


@njit(cache=True)
def _register(
    poses: FloatArray,
    scan: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    grid: NearestGrid,
    scales: FloatArray,
    one_sided: bool,
    costs: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Refine each pose by Gauss-Newton steps from wide to narrow scales; write the final costs."""
    A, b = np.empty((6, 6)), np.empty(6)
    for k in range(len(poses)):
        T_sensor_model = poses[k]
        for scale in scales:
            normal_equations(T_sensor_model, scan, points, normals, grid, scale, one_sided, A, b)
            trace = 0.0
            for i in range(6):
                trace += A[i, i]
            if trace <= 0.0:
                break
            for i in range(6):
                A[i, i] += _DAMPING * trace / 6.0 + 1e-300
            if not solve6(A, b):
                break
            update(T_sensor_model, b)
        costs[k] = _cost(T_sensor_model, scan, points, normals, grid, scales[-1], one_sided)


@njit(cache=True)
def normal_equations(
    T_sensor_model: FloatArray,
    scan: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    grid: NearestGrid,
    scale: float,
    one_sided: bool,
    A: FloatArray,
    b: FloatArray,
) -> int:  # pragma: no cover - compiled
    """Set A (6, 6) and b (6,) for the step [rx ry rz x y z] in the frame of the model; return the pairs."""
    A[:] = 0.0
    b[:] = 0.0
    J = np.empty(6)
    limit2, used_points = scale * scale, 0
    sensor_x, sensor_y, sensor_z = inverse_translation(T_sensor_model)
    for i in range(len(scan)):
        x, y, z = inverse_transformed(T_sensor_model, scan[i, 0], scan[i, 1], scan[i, 2])
        row = nearest_row(grid, x, y, z)
        n = normals[row]
        q = points[row]
        if (
            one_sided
            and n[0] * (sensor_x - q[0]) + n[1] * (sensor_y - q[1]) + n[2] * (sensor_z - q[2]) <= 0.0
        ):
            continue
        ex, ey, ez = x - q[0], y - q[1], z - q[2]
        distance2 = ex * ex + ey * ey + ez * ez
        if distance2 >= limit2:
            continue
        w = (1.0 - distance2 / limit2) ** 2
        r = n[0] * ex + n[1] * ey + n[2] * ez
        J[0], J[1], J[2] = cross(x, y, z, n[0], n[1], n[2])
        J[3], J[4], J[5] = n[0], n[1], n[2]
        for c in range(6):
            wj = w * J[c]
            b[c] -= wj * r
            for d in range(c + 1):
                A[c, d] += wj * J[d]
        # Distance between the points: rows of [-[p]x, I].
        v = _ALONG_SURFACE * w
        A[0, 0] += v * (y * y + z * z)
        A[1, 1] += v * (x * x + z * z)
        A[2, 2] += v * (x * x + y * y)
        A[1, 0] -= v * x * y
        A[2, 0] -= v * x * z
        A[2, 1] -= v * y * z
        A[3, 1] += v * z
        A[3, 2] -= v * y
        A[4, 0] -= v * z
        A[4, 2] += v * x
        A[5, 0] += v * y
        A[5, 1] -= v * x
        for c in range(3):
            A[3 + c, 3 + c] += v
        cx, cy, cz = cross(x, y, z, ex, ey, ez)
        b[0] -= v * cx
        b[1] -= v * cy
        b[2] -= v * cz
        b[3] -= v * ex
        b[4] -= v * ey
        b[5] -= v * ez
        used_points += 1
    for c in range(6):
        for d in range(c + 1, 6):
            A[c, d] = A[d, c]
    return used_points


@njit(cache=True)
def solve6(A: FloatArray, b: FloatArray) -> bool:  # pragma: no cover - compiled
    """Solve A x = b in place by Cholesky; return False if A is not positive definite."""
    n = len(b)
    for j in range(n):
        s = A[j, j]
        for k in range(j):
            s -= A[j, k] * A[j, k]
        if s <= 0.0:
            return False
        d = math.sqrt(s)
        A[j, j] = d
        for i in range(j + 1, n):
            s = A[i, j]
            for k in range(j):
                s -= A[i, k] * A[j, k]
            A[i, j] = s / d
    for i in range(n):
        s = b[i]
        for k in range(i):
            s -= A[i, k] * b[k]
        b[i] = s / A[i, i]
    for i in range(n - 1, -1, -1):
        s = b[i]
        for k in range(i + 1, n):
            s -= A[k, i] * b[k]
        b[i] = s / A[i, i]
    return True


@njit(cache=True)
def update(T_sensor_model: FloatArray, step: FloatArray) -> None:  # pragma: no cover - compiled
    """Apply a step that moves the scan by [rx ry rz x y z] in the frame of the model: T <- T Exp(step)^-1."""
    angle = math.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    E = np.eye(3)
    if angle > 1e-12:
        a, c = math.sin(angle) / angle, (1.0 - math.cos(angle)) / (angle * angle)
        x, y, z = step[0], step[1], step[2]
        E[0, 0], E[0, 1], E[0, 2] = 1.0 - c * (y * y + z * z), c * x * y - a * z, c * x * z + a * y
        E[1, 0], E[1, 1], E[1, 2] = c * x * y + a * z, 1.0 - c * (x * x + z * z), c * y * z - a * x
        E[2, 0], E[2, 1], E[2, 2] = c * x * z - a * y, c * y * z + a * x, 1.0 - c * (x * x + y * y)
    # p' = E p + s in the model, p = R^T (s_sensor - t): R' = R E^T, t' = t - R' s.
    R = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            R[i, j] = (
                T_sensor_model[i, 0] * E[j, 0]
                + T_sensor_model[i, 1] * E[j, 1]
                + T_sensor_model[i, 2] * E[j, 2]
            )
    for i in range(3):
        for j in range(3):
            T_sensor_model[i, j] = R[i, j]
    for i in range(3):
        T_sensor_model[i, 3] -= R[i, 0] * step[3] + R[i, 1] * step[4] + R[i, 2] * step[5]


@njit(cache=True)
def _cost(
    T_sensor_model: FloatArray,
    scan: FloatArray,
    points: FloatArray,
    normals: FloatArray,
    grid: NearestGrid,
    scale: float,
    one_sided: bool,
) -> float:  # pragma: no cover - compiled
    """Return the mean squared distance of the scan from the model, truncated at ``scale`` and divided by its
    square.
    """
    total, limit2 = 0.0, scale * scale
    sensor_x, sensor_y, sensor_z = inverse_translation(T_sensor_model)
    for i in range(len(scan)):
        x, y, z = inverse_transformed(T_sensor_model, scan[i, 0], scan[i, 1], scan[i, 2])
        row = nearest_row(grid, x, y, z)
        q, n = points[row], normals[row]
        if (
            one_sided
            and n[0] * (sensor_x - q[0]) + n[1] * (sensor_y - q[1]) + n[2] * (sensor_z - q[2]) <= 0.0
        ):
            total += limit2
            continue
        distance2 = (x - q[0]) ** 2 + (y - q[1]) ** 2 + (z - q[2]) ** 2
        total += min(distance2, limit2)
    return total / (limit2 * len(scan))

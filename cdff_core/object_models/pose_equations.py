# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normal equations of a pose and its rate from the points of a scan: point-to-plane distances.

The unknowns are errors of the pose (x y z, rx ry rz in the sensor's axes, rotation about the origin of the
body) and their derivatives with respect to time. A point that was measured ``t`` after the time of the pose
depends on the error of the pose plus ``t`` times that of the rate.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.small_vectors import cross, inverse_transformed, rotated
from cdff_core.object_models.nearest_grid import NearestGrid, nearest_row
from cdff_core.object_models.rendering import Window, draw

#: Smallest cosine of the angle of incidence of a ray that is used.
_MIN_COSINE = 0.05
#: A depth belongs to a face seen edge-on if it differs from the depth at the centre of the pixel by more
#: than this fraction.
_EDGE = 0.1


@njit(cache=True)
def nearest_distances(
    T_sensor_model: FloatArray, points: FloatArray, surface: FloatArray, grid: NearestGrid
) -> FloatArray:  # pragma: no cover - compiled
    """Return the distances (n,) of points (n, 3) from the nearest points of the surface."""
    out = np.empty(len(points))
    for i in range(len(points)):
        x, y, z = inverse_transformed(T_sensor_model, points[i, 0], points[i, 1], points[i, 2])
        q = surface[nearest_row(grid, x, y, z)]
        out[i] = np.sqrt((x - q[0]) ** 2 + (y - q[1]) ** 2 + (z - q[2]) ** 2)
    return out


@njit(cache=True)
def nearest_equations(
    T_sensor_model: FloatArray,
    points: FloatArray,
    times: FloatArray,
    surface: FloatArray,
    normals: FloatArray,
    grid: NearestGrid,
    scale: float,
    A: FloatArray,
    b: FloatArray,
) -> float:  # pragma: no cover - compiled
    """Set A (12, 12) and b (12,) from the distances to the planes of the nearest points; return the weights.

    Pairs further apart than ``scale``, and those whose surface faces away from the sensor, have no weight.
    """
    A[:] = 0.0
    b[:] = 0.0
    J = np.empty(6)
    total, limit2 = 0.0, scale * scale
    for i in range(len(points)):
        px = points[i, 0] - T_sensor_model[0, 3]
        py = points[i, 1] - T_sensor_model[1, 3]
        pz = points[i, 2] - T_sensor_model[2, 3]
        x, y, z = rotated(T_sensor_model.T, px, py, pz)
        row = nearest_row(grid, x, y, z)
        n, q = normals[row], surface[row]
        nx, ny, nz = rotated(T_sensor_model, n[0], n[1], n[2])
        if nx * points[i, 0] + ny * points[i, 1] + nz * points[i, 2] >= 0.0:
            continue
        ex, ey, ez = x - q[0], y - q[1], z - q[2]
        distance2 = ex * ex + ey * ey + ez * ez
        if distance2 >= limit2:
            continue
        w = (1.0 - distance2 / limit2) ** 2
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = cross(px, py, pz, nx, ny, nz)
        _add(J, times[i], w, n[0] * ex + n[1] * ey + n[2] * ez, A, b)
        total += w
    _mirror(A)
    return total


@njit(cache=True)
def rendered_equations(
    T_view_model: FloatArray,
    points: FloatArray,
    times: FloatArray,
    vertices: FloatArray,
    triangles: IntArray,
    window: Window,
    surface: FloatArray,
    grid: NearestGrid,
    limit: float,
    miss: float,
    A: FloatArray,
    b: FloatArray,
    residuals: FloatArray,
) -> float:  # pragma: no cover - compiled
    """Set A (12, 12), b (12,) and the residuals (n,) from differences of measured and rendered range.

    Parameters
    ----------
    miss : float
        Weight of the distance of a ray from the outline that it misses, relative to a range; 0: none.
    T_view_model : ndarray, shape (4, 4)
        Pose of the model in the view, whose third axis is the optical one; the points are in the view.
    limit : float
        Difference from which a ray has no weight, metres.
    residuals : ndarray, shape (n,)
        Measured minus rendered range; NaN for rays that miss the model or the window.

    Returns
    -------
    float
        Sum of the weights.
    """
    inverse_depth = np.zeros((window.rows, window.columns))
    face = np.full((window.rows, window.columns), -1)
    scratch = np.empty((len(vertices), 3))
    draw(vertices, triangles, T_view_model, window, inverse_depth, face, scratch)
    A[:] = 0.0
    b[:] = 0.0
    J = np.empty(6)
    total = 0.0
    for i in range(len(points)):
        residuals[i] = np.nan
        z = points[i, 2]
        if z <= 0.0:
            continue
        u, v = points[i, 0] / z, points[i, 1] / z
        column, row = int(np.rint(window.fx * u + window.cx)), int(np.rint(window.fy * v + window.cy))
        if column < 0 or row < 0 or column >= window.columns or row >= window.rows:
            continue
        if face[row, column] < 0:
            if miss > 0.0:
                total += _add_miss(T_view_model, points[i], times[i], surface, grid, limit, miss, A, b)
            continue
        corners = triangles[face[row, column]]
        a, p, q = scratch[corners[0]], scratch[corners[1]], scratch[corners[2]]
        gx, gy, gz = p[0] - a[0], p[1] - a[1], p[2] - a[2]
        hx, hy, hz = q[0] - a[0], q[1] - a[1], q[2] - a[2]
        nx, ny, nz = cross(gx, gy, gz, hx, hy, hz)
        norm = np.sqrt(nx * nx + ny * ny + nz * nz)
        slope = np.sqrt(1.0 + u * u + v * v)
        along = nx * u + ny * v + nz
        if norm == 0.0 or abs(along) < _MIN_COSINE * norm * slope:
            continue
        depth = (nx * a[0] + ny * a[1] + nz * a[2]) / along
        if abs(depth * inverse_depth[row, column] - 1.0) > _EDGE:
            continue
        r = (z - depth) * slope
        residuals[i] = r
        if abs(r) >= limit:
            continue
        w = (1.0 - (r / limit) ** 2) ** 2
        # The range of a plane along a ray d changes by n . (x + phi x (q - t)) / (n . d).
        s = slope / along
        x, y, z = u * depth - T_view_model[0, 3], v * depth - T_view_model[1, 3], depth - T_view_model[2, 3]
        nx, ny, nz = nx * s, ny * s, nz * s
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = cross(x, y, z, nx, ny, nz)
        _add(J, times[i], w, r, A, b)
        total += w
    _mirror(A)
    return total


@njit(cache=True)
def _add_miss(
    T_view_model: FloatArray,
    point: FloatArray,
    t: float,
    surface: FloatArray,
    grid: NearestGrid,
    limit: float,
    miss: float,
    A: FloatArray,
    b: FloatArray,
) -> float:  # pragma: no cover - compiled
    """Add the distance of a ray that misses the model from its outline; return the weight."""
    p = point - T_view_model[:3, 3]
    model_x, model_y, model_z = rotated(T_view_model.T, p[0], p[1], p[2])
    q = surface[nearest_row(grid, model_x, model_y, model_z)]
    x, y, z = rotated(T_view_model, q[0], q[1], q[2])
    e = np.array([x, y, z]) + T_view_model[:3, 3] - point
    # Only the part across the ray: a ray that misses has no range to compare.
    ray = point / np.sqrt(point[0] ** 2 + point[1] ** 2 + point[2] ** 2)
    e -= (e[0] * ray[0] + e[1] * ray[1] + e[2] * ray[2]) * ray
    distance = np.sqrt(e[0] ** 2 + e[1] ** 2 + e[2] ** 2)
    if distance >= limit or distance < 1e-9:
        return 0.0
    n = -e / distance
    J = np.empty(6)
    J[0], J[1], J[2] = n[0], n[1], n[2]
    J[3], J[4], J[5] = cross(p[0], p[1], p[2], n[0], n[1], n[2])
    w: float = miss * (1.0 - (distance / limit) ** 2) ** 2
    _add(J, t, w, distance, A, b)
    return w


@njit(cache=True, inline="always")
def _add(
    J: FloatArray, t: float, w: float, r: float, A: FloatArray, b: FloatArray
) -> None:  # pragma: no cover - compiled
    """Add a row to the upper blocks: A = [[S, S1], [., S2]]."""
    for i in range(6):
        wj = w * J[i]
        b[i] += wj * r
        b[6 + i] += t * wj * r
        for k in range(6):
            product = wj * J[k]
            A[i, k] += product
            A[i, 6 + k] += t * product
            A[6 + i, 6 + k] += t * t * product


@njit(cache=True, inline="always")
def _mirror(A: FloatArray) -> None:  # pragma: no cover - compiled
    for i in range(6):
        for k in range(6):
            A[6 + i, k] = A[i, 6 + k]

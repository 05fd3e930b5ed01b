# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled registration of a sweep with the planes of a voxel table: normal equations and observability."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.small_vectors import cross, rotated
from cdff_core.dfns.scan_to_map_registration._voxel_table import (
    ANGLE_VARIANCE,
    FIRST_NORMAL,
    MEAN,
    NORMAL,
    SECOND_NORMAL,
    VARIANCE,
    VoxelTable,
    pack,
    row_of,
)

#: Offsets of a voxel and its 26 neighbours, nearest first.
_NEIGHBOURS = np.array(
    [[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], dtype=np.int64
)
_NEIGHBOURS = _NEIGHBOURS[np.argsort(np.abs(_NEIGHBOURS).sum(axis=1), kind="stable")]
#: Number of voxels searched for a plane: the voxel of the point and those with a common face.
_SEARCHED_VOXELS = 7


@njit(cache=True)
def deskew_point(
    point: FloatArray, point_time: float, theta: FloatArray, rho: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the point ``Exp(f theta) p + f rho`` to ``out``: its position in the sensor frame at the end of
    the sweep, for its time ``f`` from -1 (start) to 0 (end) and the rotation ``theta`` and translation
    ``rho`` during the sweep.
    """
    wx, wy, wz = point_time * theta[0], point_time * theta[1], point_time * theta[2]
    a2 = wx * wx + wy * wy + wz * wz
    s, c = 1.0 - a2 / 6.0, 0.5 - a2 / 24.0
    if a2 > 1e-4:
        a = math.sqrt(a2)
        s, c = math.sin(a) / a, (1.0 - math.cos(a)) / a2
    px, py, pz = point[0], point[1], point[2]
    cx, cy, cz = cross(wx, wy, wz, px, py, pz)
    dx, dy, dz = cross(wx, wy, wz, cx, cy, cz)
    out[0] = px + s * cx + c * dx + point_time * rho[0]
    out[1] = py + s * cy + c * dy + point_time * rho[1]
    out[2] = pz + s * cz + c * dz + point_time * rho[2]


@njit(cache=True)
def nearest_plane(
    tables: tuple[VoxelTable, ...], voxel: float, finest: int, x: float, y: float, z: float
) -> tuple[int, int]:  # pragma: no cover - compiled
    """Return level and row of the plane with the nearest mean among the voxels around a point; the row is -1
    if none of them has a plane.

    The voxels of level 0 have the edge ``voxel``, those of each further level twice the edge of the previous
    one. The result is from the first level, starting at ``finest``, with a plane near the point: where the
    rings of a sweep are too far apart for planes in small voxels, larger voxels contain several rings.
    """
    for level in range(finest, len(tables)):
        edge = voxel * (1 << level)
        table = tables[level]
        i, j, k = int(np.floor(x / edge)), int(np.floor(y / edge)), int(np.floor(z / edge))
        best, row_best = 1e300, -1
        for d in range(_SEARCHED_VOXELS):
            key = pack(i + _NEIGHBOURS[d, 0], j + _NEIGHBOURS[d, 1], k + _NEIGHBOURS[d, 2])
            row = row_of(table.keys, key)
            plane = table.planes[row]
            if table.keys[row] < 0 or plane[VARIANCE] < 0.0:
                continue
            dx, dy, dz = plane[MEAN] - x, plane[MEAN + 1] - y, plane[MEAN + 2] - z
            d2 = dx * dx + dy * dy + dz * dz
            if d2 < best:
                best, row_best = d2, row
        if row_best >= 0:
            return level, row_best
    return len(tables), -1


@njit(cache=True, inline="always")
def weighted_distance(
    plane: FloatArray, x: float, y: float, z: float, kernel: float, noise: float, least_noise: float
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Return the signed distance of a point from a plane, and its weight.

    The weight is that of the Geman-McClure kernel of width ``kernel`` times ``least_noise^2 / s^2``, where
    ``s^2`` is the variance of the distance: ``noise``, the variance of the plane, and the uncertainty of its
    normal, which increases with the distance from the mean. The normal is uncertain if the points are nearly
    on a line, as in a voxel with few rings.
    """
    dx, dy, dz = x - plane[MEAN], y - plane[MEAN + 1], z - plane[MEAN + 2]
    r = plane[NORMAL] * dx + plane[NORMAL + 1] * dy + plane[NORMAL + 2] * dz
    w = kernel * kernel / (kernel * kernel + r * r)
    along = dx * dx + dy * dy + dz * dz - r * r
    variance = (noise * noise + plane[VARIANCE]) * (1.0 + plane[ANGLE_VARIANCE] * along)
    return r, w * w * least_noise * least_noise / variance


@njit(cache=True)
def normal_equations(
    tables: tuple[VoxelTable, ...],
    voxel: float,
    finest: int,
    points: FloatArray,
    point_times: FloatArray,
    R_map_sensor: FloatArray,
    t_map_sensor: FloatArray,
    theta: FloatArray,
    rho: FloatArray,
    kernel: float,
    noise: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return the Gauss-Newton system of pose and motion during the sweep.

    The 12 unknowns are the translation and rotation of the sensor at the end of the sweep, in axes of the
    map, and the change of the translation and rotation during the sweep, in axes of the sensor. The weights
    are those of ``weighted_distance`` with the standard deviation ``noise`` (levels,) of distances at each
    level.

    Returns
    -------
    tuple of ndarray
        Hessian H (12, 12), gradient b (12,), and the sums over the matched points (5,): weights, number of
        points, weighted squared residuals, weighted squared distances from the sensor, weights of the robust
        kernel alone; and for each level (levels, 2) the sums of these weights and of the squared residuals
        times them.
    """
    H, b, sums, level_sums = np.zeros((12, 12)), np.zeros(12), np.zeros(5), np.zeros((len(tables), 2))
    J, q = np.empty(12), np.empty(3)
    for p in range(len(points)):
        f = point_times[p]
        deskew_point(points[p], f, theta, rho, q)
        ax, ay, az = rotated(R_map_sensor, q[0], q[1], q[2])
        x, y, z = ax + t_map_sensor[0], ay + t_map_sensor[1], az + t_map_sensor[2]
        level, row = nearest_plane(tables, voxel, finest, x, y, z)
        if row < 0:
            continue
        plane = tables[level].planes[row]
        nx, ny, nz = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
        r, w = weighted_distance(plane, x, y, z, kernel, noise[level], noise[0])
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = cross(ax, ay, az, nx, ny, nz)
        bx, by, bz = rotated(R_map_sensor.T, nx, ny, nz)
        J[6], J[7], J[8] = bx, by, bz
        J[9], J[10], J[11] = cross(q[0], q[1], q[2], bx, by, bz)
        for i in range(6, 12):
            J[i] *= f
        for i in range(12):
            wj = w * J[i]
            b[i] += wj * r
            for k in range(i + 1):
                H[i, k] += wj * J[k]
        sums[0] += w
        sums[1] += 1.0
        sums[2] += w * r * r
        sums[3] += w * (ax * ax + ay * ay + az * az)
        support = (kernel * kernel / (kernel * kernel + r * r)) ** 2
        sums[4] += support
        level_sums[level, 0] += support
        level_sums[level, 1] += support * r * r
    for i in range(12):
        for k in range(i):
            H[k, i] = H[i, k]
    return H, b, sums, level_sums


@njit(cache=True)
def common_information(
    tables: tuple[VoxelTable, ...],
    voxel: float,
    points: FloatArray,
    R_map_sensor: FloatArray,
    t_map_sensor: FloatArray,
    kernel: float,
    noise: FloatArray,
    radius: float,
    min_plane_points: int,
) -> tuple[FloatArray, FloatArray, float]:  # pragma: no cover - compiled
    """Return the information on translation and rotation times ``radius``, and the part of it on which the
    normals of both halves of the map agree.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In the sensor's frame at the end of the sweep.
    R_map_sensor, t_map_sensor : ndarray
        Rotation (3, 3) and translation (3,) at the end of the sweep.
    min_plane_points : int
        Planes through fewer points are skipped.

    Returns
    -------
    tuple
        Mean of the information of both halves (6, 6), symmetric part of their cross information (6, 6), both
        divided by the sum of the weights, and that sum; a point on an exact plane has weight 1.
    """
    H, X, total = np.zeros((6, 6)), np.zeros((6, 6)), 0.0
    A, B = np.empty(6), np.empty(6)
    for p in range(len(points)):
        q = points[p]
        ax, ay, az = rotated(R_map_sensor, q[0], q[1], q[2])
        x, y, z = ax + t_map_sensor[0], ay + t_map_sensor[1], az + t_map_sensor[2]
        level, row = nearest_plane(tables, voxel, 0, x, y, z)
        if row < 0 or tables[level].counts[row, 0] + tables[level].counts[row, 1] < min_plane_points:
            continue
        plane = tables[level].planes[row]
        _, w = weighted_distance(plane, x, y, z, kernel, noise[level], noise[0])
        total += w
        for side, J in ((FIRST_NORMAL, A), (SECOND_NORMAL, B)):
            nx, ny, nz = plane[side], plane[side + 1], plane[side + 2]
            J[0], J[1], J[2] = nx, ny, nz
            jx, jy, jz = cross(ax, ay, az, nx, ny, nz)
            J[3], J[4], J[5] = jx / radius, jy / radius, jz / radius
        for i in range(6):
            for k in range(6):
                H[i, k] += 0.5 * w * (A[i] * A[k] + B[i] * B[k])
                X[i, k] += 0.5 * w * (A[i] * B[k] + B[i] * A[k])
    scale = 1.0 / max(total, 1e-12)
    return H * scale, X * scale, total


@njit(cache=True)
def supports(
    tables: tuple[VoxelTable, ...],
    voxel: float,
    finest: int,
    points: FloatArray,
    point_times: FloatArray,
    poses: FloatArray,
    motions: FloatArray,
    kernel: float,
) -> FloatArray:  # pragma: no cover - compiled
    """Return the mean weight of the robust kernel over all points for each pose ``T_map_sensor`` (m, 4, 4)
    and motion during the sweep (m, 6); points without a plane have weight 0.
    """
    result, q = np.zeros(len(poses)), np.empty(3)
    for m in range(len(poses)):
        R_map_sensor, t_map_sensor = np.ascontiguousarray(poses[m, :3, :3]), poses[m, :3, 3]
        theta, rho = motions[m, 3:], motions[m, :3]
        for p in range(len(points)):
            deskew_point(points[p], point_times[p], theta, rho, q)
            ax, ay, az = rotated(R_map_sensor, q[0], q[1], q[2])
            x, y, z = ax + t_map_sensor[0], ay + t_map_sensor[1], az + t_map_sensor[2]
            level, row = nearest_plane(tables, voxel, finest, x, y, z)
            if row < 0:
                continue
            r, _ = weighted_distance(tables[level].planes[row], x, y, z, kernel, 1.0, 1.0)
            w = kernel * kernel / (kernel * kernel + r * r)
            result[m] += w * w
    return result / max(len(points), 1)

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
    point: FloatArray, fraction: float, theta: FloatArray, rho: FloatArray, out: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the point ``Exp(f theta) p + f rho`` to ``out``: its position in the sensor frame at the end of
    the sweep, for its time ``f`` from -1 (start) to 0 (end) and the rotation ``theta`` and translation
    ``rho`` during the sweep.
    """
    wx, wy, wz = fraction * theta[0], fraction * theta[1], fraction * theta[2]
    a2 = wx * wx + wy * wy + wz * wz
    s, c = 1.0 - a2 / 6.0, 0.5 - a2 / 24.0
    if a2 > 1e-4:
        a = math.sqrt(a2)
        s, c = math.sin(a) / a, (1.0 - math.cos(a)) / a2
    px, py, pz = point[0], point[1], point[2]
    cx, cy, cz = cross(wx, wy, wz, px, py, pz)
    dx, dy, dz = cross(wx, wy, wz, cx, cy, cz)
    out[0] = px + s * cx + c * dx + fraction * rho[0]
    out[1] = py + s * cy + c * dy + fraction * rho[1]
    out[2] = pz + s * cz + c * dz + fraction * rho[2]


@njit(cache=True)
def nearest_plane(
    table: VoxelTable, voxel: float, x: float, y: float, z: float, reach: int
) -> int:  # pragma: no cover - compiled
    """Return the row of the plane with the nearest mean among the first ``reach`` voxels around the point; -1
    if none of them has a plane.
    """
    i, j, k = int(np.floor(x / voxel)), int(np.floor(y / voxel)), int(np.floor(z / voxel))
    best, row_best = 1e300, -1
    for d in range(reach):
        row = row_of(table.keys, pack(i + _NEIGHBOURS[d, 0], j + _NEIGHBOURS[d, 1], k + _NEIGHBOURS[d, 2]))
        plane = table.planes[row]
        if table.keys[row] < 0 or plane[VARIANCE] < 0.0:
            continue
        dx, dy, dz = plane[MEAN] - x, plane[MEAN + 1] - y, plane[MEAN + 2] - z
        d2 = dx * dx + dy * dy + dz * dz
        if d2 < best:
            best, row_best = d2, row
    return row_best


@njit(cache=True, inline="always")
def weighted_distance(
    plane: FloatArray, x: float, y: float, z: float, kernel: float, noise: float
) -> tuple[float, float]:  # pragma: no cover - compiled
    """Return the signed distance of a point from a plane, and its weight.

    The weight is that of the Geman-McClure kernel of width ``kernel`` times
    ``noise^2 / (noise^2 + variance of the plane)``.
    """
    r = plane[NORMAL] * (x - plane[MEAN])
    r += plane[NORMAL + 1] * (y - plane[MEAN + 1])
    r += plane[NORMAL + 2] * (z - plane[MEAN + 2])
    w = kernel * kernel / (kernel * kernel + r * r)
    return r, w * w * noise * noise / (noise * noise + plane[VARIANCE])


@njit(cache=True)
def normal_equations(
    table: VoxelTable,
    voxel: float,
    points: FloatArray,
    fraction: FloatArray,
    R: FloatArray,
    t: FloatArray,
    theta: FloatArray,
    rho: FloatArray,
    kernel: float,
    noise: float,
) -> tuple[FloatArray, FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Gauss-Newton system of pose and motion during the sweep.

    The 12 unknowns are the translation and rotation of the sensor at the end of the sweep, in axes of the
    map, and the change of the translation and rotation during the sweep, in axes of the sensor. The weights
    are those of ``weighted_distance``.

    Returns
    -------
    tuple of ndarray
        Hessian H (12, 12), gradient b (12,), and the sums over the matched points (4,): weights, number of
        points, weighted squared residuals, weighted squared distances from the sensor.
    """
    H, b, sums = np.zeros((12, 12)), np.zeros(12), np.zeros(4)
    J, q = np.empty(12), np.empty(3)
    for p in range(len(points)):
        f = fraction[p]
        deskew_point(points[p], f, theta, rho, q)
        ax, ay, az = rotated(R, q[0], q[1], q[2])
        x, y, z = ax + t[0], ay + t[1], az + t[2]
        row = nearest_plane(table, voxel, x, y, z, _SEARCHED_VOXELS)
        if row < 0:
            continue
        plane = table.planes[row]
        nx, ny, nz = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
        r, w = weighted_distance(plane, x, y, z, kernel, noise)
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = cross(ax, ay, az, nx, ny, nz)
        bx, by, bz = rotated(R.T, nx, ny, nz)
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
    for i in range(12):
        for k in range(i):
            H[k, i] = H[i, k]
    return H, b, sums


@njit(cache=True)
def common_information(
    table: VoxelTable,
    voxel: float,
    points: FloatArray,
    R: FloatArray,
    t: FloatArray,
    kernel: float,
    noise: float,
    radius: float,
    min_plane_points: int,
) -> tuple[FloatArray, FloatArray, float]:  # pragma: no cover - compiled
    """Return the information on translation and rotation times ``radius``, and the part of it on which the
    normals of both halves of the map agree.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In the sensor's frame at the end of the sweep.
    R, t : ndarray
        Rotation (3, 3) and translation (3,) of T_map_sensor at the end of the sweep.
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
        ax, ay, az = rotated(R, q[0], q[1], q[2])
        x, y, z = ax + t[0], ay + t[1], az + t[2]
        row = nearest_plane(table, voxel, x, y, z, _SEARCHED_VOXELS)
        if row < 0 or table.counts[row, 0] + table.counts[row, 1] < min_plane_points:
            continue
        plane = table.planes[row]
        _, w = weighted_distance(plane, x, y, z, kernel, noise)
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

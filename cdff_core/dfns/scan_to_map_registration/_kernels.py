# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled normal equations of a sweep on the planes of a voxel table."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray
from cdff_common.geometry.small_vectors import cross, rotated
from cdff_core.dfns.scan_to_map_registration._voxel_table import (
    FIRST,
    MEAN,
    NORMAL,
    SECOND,
    VARIANCE,
    VoxelTable,
    pack,
    row_of,
)

_NEIGHBOURS = np.array(
    [[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], dtype=np.int64
)
_NEIGHBOURS = _NEIGHBOURS[np.argsort(np.abs(_NEIGHBOURS).sum(axis=1), kind="stable")]
_FACES = 7


@njit(cache=True)
def deskewed(point, fraction, theta, rho, out):  # type: ignore[no-untyped-def] # pragma: no cover - compiled
    """Compute a point in the sensor's frame at the end of the sweep: ``Exp(f theta) p + f rho``."""
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
def nearest_plane(keys, planes, voxel, x, y, z, reach):  # type: ignore[no-untyped-def] # pragma: no cover - compiled
    """Return the row of the plane with the nearest mean around the point; -1 if there is none."""
    i, j, k = int(np.floor(x / voxel)), int(np.floor(y / voxel)), int(np.floor(z / voxel))
    best, row_best = 1e300, -1
    for d in range(reach):
        row = row_of(keys, pack(i + _NEIGHBOURS[d, 0], j + _NEIGHBOURS[d, 1], k + _NEIGHBOURS[d, 2]))
        if keys[row] < 0 or planes[row, VARIANCE] < 0.0:
            continue
        dx, dy, dz = planes[row, MEAN] - x, planes[row, MEAN + 1] - y, planes[row, MEAN + 2] - z
        d2 = dx * dx + dy * dy + dz * dz
        if d2 < best:
            best, row_best = d2, row
    return row_best


@njit(cache=True, inline="always")
def weighted_distance(plane, x, y, z, kernel, noise):  # type: ignore[no-untyped-def] # pragma: no cover - compiled
    """Return the distance of a point from a plane and its weight: Geman and McClure's of the width ``kernel``
    times ``noise^2 / (noise^2 + variance of the plane)``.
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

    The unknowns are translation and rotation of the sensor at the end of the sweep, in axes of the map, and
    change of
    the translation and rotation during the sweep, in axes of the sensor: 12. Weights as of
    ``weighted_distance``.

    Returns
    -------
    tuple of ndarray
        H (12, 12), b (12,), and: sum of the weights, matched points, weighted squared residuals, weighted
        squared ranges.
    """
    H, b, sums = np.zeros((12, 12)), np.zeros(12), np.zeros(4)
    J, q = np.empty(12), np.empty(3)
    for p in range(len(points)):
        f = fraction[p]
        deskewed(points[p], f, theta, rho, q)
        ax, ay, az = rotated(R, q[0], q[1], q[2])
        x, y, z = ax + t[0], ay + t[1], az + t[2]
        row = nearest_plane(table.keys, table.planes, voxel, x, y, z, _FACES)
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
def shared_information(
    table: VoxelTable,
    voxel: float,
    points: FloatArray,
    R: FloatArray,
    t: FloatArray,
    kernel: float,
    noise: float,
    radius: float,
    known: int,
) -> tuple[FloatArray, FloatArray, float]:  # pragma: no cover - compiled
    """Information on translation and rotation times ``radius``, by the normals of both halves of the map.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In the sensor's frame at the end of the sweep.
    known : int
        Planes through fewer points are skipped.

    Returns
    -------
    tuple
        Mean of both halves' information (6, 6), cross information (6, 6; symmetric part), both per weight,
        and the sum of the weights that a measurement with the least noise would have 1 of.
    """
    H, X, total = np.zeros((6, 6)), np.zeros((6, 6)), 0.0
    A, B = np.empty(6), np.empty(6)
    for p in range(len(points)):
        q = points[p]
        ax, ay, az = rotated(R, q[0], q[1], q[2])
        x, y, z = ax + t[0], ay + t[1], az + t[2]
        row = nearest_plane(table.keys, table.planes, voxel, x, y, z, _FACES)
        if row < 0 or table.counts[row, 0] + table.counts[row, 1] < known:
            continue
        m = table.planes[row]
        _, w = weighted_distance(m, x, y, z, kernel, noise)
        total += w
        for side, J in ((FIRST, A), (SECOND, B)):
            nx, ny, nz = m[side], m[side + 1], m[side + 2]
            J[0], J[1], J[2] = nx, ny, nz
            jx, jy, jz = cross(ax, ay, az, nx, ny, nz)
            J[3], J[4], J[5] = jx / radius, jy / radius, jz / radius
        for i in range(6):
            for k in range(6):
                H[i, k] += 0.5 * w * (A[i] * A[k] + B[i] * B[k])
                X[i, k] += 0.5 * w * (A[i] * B[k] + B[i] * A[k])
    scale = 1.0 / max(total, 1e-12)
    return H * scale, X * scale, total

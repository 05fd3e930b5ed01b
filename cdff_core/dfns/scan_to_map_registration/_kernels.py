# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compiled normal equations of a sweep on the planes of a voxel table."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from cdff_core.dfns.scan_to_map_registration._voxel_table import (
    FIRST,
    MEAN,
    NORMAL,
    SECOND,
    VARIANCE,
    Float,
    VoxelTable,
    pack,
    row_of,
)

_NEIGHBOURS = np.array([[i, j, k] for i in (-1, 0, 1) for j in (-1, 0, 1) for k in (-1, 0, 1)], dtype=np.int64)
_NEIGHBOURS = _NEIGHBOURS[np.argsort(np.abs(_NEIGHBOURS).sum(axis=1), kind="stable")]
_FACES = 7


@njit(cache=True)
def turned(point, fraction, theta, rho, out):  # type: ignore[no-untyped-def] # pragma: no cover - compiled
    """Point of the sweep in the sensor's frame at the end of it: ``Exp(f theta) p + f rho``."""
    wx, wy, wz = fraction * theta[0], fraction * theta[1], fraction * theta[2]
    a2 = wx * wx + wy * wy + wz * wz
    s, c = 1.0 - a2 / 6.0, 0.5 - a2 / 24.0
    if a2 > 1e-4:
        a = math.sqrt(a2)
        s, c = math.sin(a) / a, (1.0 - math.cos(a)) / a2
    px, py, pz = point[0], point[1], point[2]
    cx, cy, cz = wy * pz - wz * py, wz * px - wx * pz, wx * py - wy * px
    out[0] = px + s * cx + c * (wy * cz - wz * cy) + fraction * rho[0]
    out[1] = py + s * cy + c * (wz * cx - wx * cz) + fraction * rho[1]
    out[2] = pz + s * cz + c * (wx * cy - wy * cx) + fraction * rho[2]


@njit(cache=True)
def nearest_plane(keys, planes, voxel, x, y, z, reach):  # type: ignore[no-untyped-def] # pragma: no cover - compiled
    """Row of the plane whose mean is nearest, among the point's voxel and those around it; -1 where there is none."""
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


@njit(cache=True)
def normal_equations(
    table: VoxelTable,
    voxel: float,
    points: Float,
    fraction: Float,
    R: Float,
    t: Float,
    theta: Float,
    rho: Float,
    kernel: float,
    noise: float,
) -> tuple[Float, Float, Float]:  # pragma: no cover - compiled
    """Gauss-Newton system of pose and motion during the sweep.

    The unknowns are shift and turn of the sensor at the end of the sweep, in axes of the map, and change of the
    translation and rotation during the sweep, in axes of the sensor: 12. Weights are Geman and McClure's of the width
    ``kernel`` times ``noise^2 / (noise^2 + variance of the plane)``.

    Returns
    -------
    tuple of ndarray
        H (12, 12), b (12,), and: sum of the weights, matched points, weighted squared residuals, weighted squared
        ranges.
    """
    H, b, sums = np.zeros((12, 12)), np.zeros(12), np.zeros(4)
    J, q = np.empty(12), np.empty(3)
    for p in range(len(points)):
        f = fraction[p]
        turned(points[p], f, theta, rho, q)
        ax = R[0, 0] * q[0] + R[0, 1] * q[1] + R[0, 2] * q[2]
        ay = R[1, 0] * q[0] + R[1, 1] * q[1] + R[1, 2] * q[2]
        az = R[2, 0] * q[0] + R[2, 1] * q[1] + R[2, 2] * q[2]
        row = nearest_plane(table.keys, table.planes, voxel, ax + t[0], ay + t[1], az + t[2], _FACES)
        if row < 0:
            continue
        plane = table.planes[row]
        nx, ny, nz = plane[NORMAL], plane[NORMAL + 1], plane[NORMAL + 2]
        r = nx * (ax + t[0] - plane[MEAN]) + ny * (ay + t[1] - plane[MEAN + 1]) + nz * (az + t[2] - plane[MEAN + 2])
        w = kernel * kernel / (kernel * kernel + r * r)
        w = w * w * noise * noise / (noise * noise + plane[VARIANCE])
        J[0], J[1], J[2] = nx, ny, nz
        J[3], J[4], J[5] = ay * nz - az * ny, az * nx - ax * nz, ax * ny - ay * nx
        bx = R[0, 0] * nx + R[1, 0] * ny + R[2, 0] * nz
        by = R[0, 1] * nx + R[1, 1] * ny + R[2, 1] * nz
        bz = R[0, 2] * nx + R[1, 2] * ny + R[2, 2] * nz
        J[6], J[7], J[8] = f * bx, f * by, f * bz
        J[9] = f * (q[1] * bz - q[2] * by)
        J[10] = f * (q[2] * bx - q[0] * bz)
        J[11] = f * (q[0] * by - q[1] * bx)
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
    points: Float,
    R: Float,
    t: Float,
    kernel: float,
    noise: float,
    radius: float,
    known: int,
) -> tuple[Float, Float, float]:  # pragma: no cover - compiled
    """Information on shift and turn times ``radius``, by the normals of both halves of the map, and by their product.

    Parameters
    ----------
    points : ndarray, shape (n, 3)
        In the sensor's frame at the end of the sweep.
    known : int
        Planes through fewer points are passed over.

    Returns
    -------
    tuple
        Mean of both halves' information (6, 6), cross information (6, 6; symmetric part), both per weight, and the sum
        of the weights that a measurement with the least noise would have 1 of.
    """
    H, X, total = np.zeros((6, 6)), np.zeros((6, 6)), 0.0
    A, B = np.empty(6), np.empty(6)
    for p in range(len(points)):
        q = points[p]
        ax = R[0, 0] * q[0] + R[0, 1] * q[1] + R[0, 2] * q[2]
        ay = R[1, 0] * q[0] + R[1, 1] * q[1] + R[1, 2] * q[2]
        az = R[2, 0] * q[0] + R[2, 1] * q[1] + R[2, 2] * q[2]
        row = nearest_plane(table.keys, table.planes, voxel, ax + t[0], ay + t[1], az + t[2], _FACES)
        if row < 0 or table.counts[row, 0] + table.counts[row, 1] < known:
            continue
        m = table.planes[row]
        r = (
            m[NORMAL] * (ax + t[0] - m[MEAN])
            + m[NORMAL + 1] * (ay + t[1] - m[MEAN + 1])
            + m[NORMAL + 2] * (az + t[2] - m[MEAN + 2])
        )
        w = kernel * kernel / (kernel * kernel + r * r)
        w = w * w * noise * noise / (noise * noise + m[VARIANCE])
        total += w
        for side, J in ((FIRST, A), (SECOND, B)):
            nx, ny, nz = m[side], m[side + 1], m[side + 2]
            J[0], J[1], J[2] = nx, ny, nz
            J[3] = (ay * nz - az * ny) / radius
            J[4] = (az * nx - ax * nz) / radius
            J[5] = (ax * ny - ay * nx) / radius
        for i in range(6):
            for k in range(6):
                H[i, k] += 0.5 * w * (A[i] * A[k] + B[i] * B[k])
                X[i, k] += 0.5 * w * (A[i] * B[k] + B[i] * A[k])
    scale = 1.0 / max(total, 1e-12)
    return H * scale, X * scale, total

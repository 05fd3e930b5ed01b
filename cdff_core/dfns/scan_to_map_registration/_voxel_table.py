# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Open-addressing hash table of voxels with the moments of their points and the planes through them.

Every voxel has two sets of moments, of alternating points: the planes of both halves have independent noise.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from cdff_common.arrays import FloatArray, IntArray
from cdff_common.geometry.plane_fits import eigen

EMPTY = np.int64(-1)
_OFFSET = 1 << 20  # cells count from -2^20 to 2^20 along each axis: 21 bits
#: 2^64 divided by the golden ratio: multiplicative (Fibonacci) hashing.
_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
#: Number of points from which a plane is fitted.
_MIN_PLANE_POINTS = 6
#: Number of points per independent measurement of a plane: neighbouring points have the same error by relief.
_POINTS_PER_MEASUREMENT = 10.0
#: A voxel has a plane if the middle eigenvalue of its points' covariance is at least this fraction of the
#: squared edge, and the smallest eigenvalue at most this fraction of the middle one.
_MIN_MIDDLE_VARIANCE, _MAX_THICKNESS_RATIO = 0.0025, 0.2
#: First columns in ``planes`` of: mean, normal of all points, normals of the first and second half of the
#: points, variance along the normal (negative: no plane), and variance of the normal's angle relative to the
#: variance of the points, 1/m^2.
MEAN, NORMAL, FIRST_NORMAL, SECOND_NORMAL, VARIANCE, ANGLE_VARIANCE = 0, 3, 6, 9, 12, 13


class VoxelTable(NamedTuple):
    """Columns with one row per voxel; rows are found by the hash of the cell.

    Attributes
    ----------
    keys : ndarray of int64, shape (c,)
        Packed cell, or ``EMPTY``; c is a power of two.
    counts : ndarray of int64, shape (c, 3)
        Number of points of each half, and of both at the last fit of the planes.
    sums : ndarray, shape (c, 2, 9)
        Sums of x y z xx xy xz yy yz zz of each half, relative to the voxel's centre, metres.
    planes : ndarray, shape (c, 14)
        Columns as of ``MEAN`` to ``ANGLE_VARIANCE``.
    used : ndarray of int64, shape (1,)
        Number of voxels in the table.
    """

    keys: IntArray
    counts: IntArray
    sums: FloatArray
    planes: FloatArray
    used: IntArray


def empty_table(capacity: int) -> VoxelTable:
    """Return an empty table for fewer than ``capacity`` voxels, a power of two."""
    return VoxelTable(
        np.full(capacity, EMPTY),
        np.zeros((capacity, 3), np.int64),
        np.zeros((capacity, 2, 9)),
        np.full((capacity, 14), -1.0),
        np.zeros(1, np.int64),
    )


@njit(cache=True, inline="always")
def pack(i: int, j: int, k: int) -> int:  # pragma: no cover - compiled
    """Return the key of a cell: its indices packed into one integer."""
    return ((i + _OFFSET) << 42) | ((j + _OFFSET) << 21) | (k + _OFFSET)


@njit(cache=True, inline="always")
def row_of(keys: IntArray, key: int) -> int:  # pragma: no cover - compiled
    """Return the row of the key, or the empty row where it would be inserted."""
    mask = len(keys) - 1
    row = np.int64((np.uint64(key) * _GOLDEN) >> np.uint64(20)) & mask
    while keys[row] != EMPTY and keys[row] != key:
        row = (row + 1) & mask
    return row  # type: ignore[return-value]


@njit(cache=True)
def first_in_voxels(points: FloatArray, voxel: float) -> IntArray:  # pragma: no cover - compiled
    """Return the indices of the first finite point of each voxel, in the order of the points."""
    capacity = 1024
    while capacity < 2 * len(points):
        capacity *= 2
    keys = np.full(capacity, EMPTY)
    first_points = np.empty(len(points), np.int64)
    n = 0
    for p in range(len(points)):
        x, y, z = points[p, 0], points[p, 1], points[p, 2]
        if not np.isfinite(x + y + z):
            continue
        key = pack(int(np.floor(x / voxel)), int(np.floor(y / voxel)), int(np.floor(z / voxel)))
        row = row_of(keys, key)
        if keys[row] == EMPTY:
            keys[row] = key
            first_points[n] = p
            n += 1
    return first_points[:n]


@njit(cache=True)
def add(
    table: VoxelTable, points: FloatArray, voxel: float, max_points: int
) -> None:  # pragma: no cover - compiled
    """Add points to the moments of their voxels, up to ``max_points`` per voxel, and fit planes again where
    the number of points has grown by a quarter since the last fit.
    """
    keys, counts, sums, planes, used = table
    rows_to_fit = np.empty(len(points), np.int64)
    n = 0
    for p in range(len(points)):
        i = int(np.floor(points[p, 0] / voxel))
        j = int(np.floor(points[p, 1] / voxel))
        k = int(np.floor(points[p, 2] / voxel))
        key = pack(i, j, k)
        row = row_of(keys, key)
        if keys[row] == EMPTY:
            keys[row] = key
            used[0] += 1
        total = counts[row, 0] + counts[row, 1]
        if total >= max_points:
            continue
        half = total & 1
        counts[row, half] += 1
        x = points[p, 0] - (i + 0.5) * voxel
        y = points[p, 1] - (j + 0.5) * voxel
        z = points[p, 2] - (k + 0.5) * voxel
        s = sums[row, half]
        s[0] += x
        s[1] += y
        s[2] += z
        s[3] += x * x
        s[4] += x * y
        s[5] += x * z
        s[6] += y * y
        s[7] += y * z
        s[8] += z * z
        if total + 1 >= _MIN_PLANE_POINTS and 4 * (total + 1) >= 5 * counts[row, 2]:
            counts[row, 2] = total + 1
            rows_to_fit[n] = row
            n += 1
    m, values, vectors = np.empty((3, 3)), np.empty(3), np.empty((3, 3))
    for t in range(n):
        row = rows_to_fit[t]
        if t + 1 < n and rows_to_fit[t + 1] == row:
            continue
        _fit_planes(counts[row], sums[row], planes[row], keys[row], voxel, m, values, vectors)


@njit(cache=True)
def _fit_planes(
    counts: IntArray,
    sums: FloatArray,
    plane: FloatArray,
    key: int,
    voxel: float,
    m: FloatArray,
    values: FloatArray,
    vectors: FloatArray,
) -> None:  # pragma: no cover - compiled
    """Fit planes through all points of a voxel and through each half; lines and clusters have none.

    ``m``, ``values`` and ``vectors`` are scratch arrays for the covariance and its eigenvalue decomposition.
    """
    plane[VARIANCE] = -1.0
    total = float(counts[0] + counts[1])
    _mean_and_covariance(sums[0] + sums[1], total, m, plane)
    eigen(m, values, vectors)
    if values[1] < _MIN_MIDDLE_VARIANCE * voxel * voxel or values[0] > _MAX_THICKNESS_RATIO * values[1]:
        return
    variance = max(values[0], 0.0)
    plane[ANGLE_VARIANCE] = _POINTS_PER_MEASUREMENT / (total * values[1])
    for c in range(3):
        plane[NORMAL + c] = vectors[c, 0]
    for half in range(2):
        _mean_and_covariance(sums[half], float(counts[half]), m, plane)
        eigen(m, values, vectors)
        dot = 0.0
        for c in range(3):
            dot += vectors[c, 0] * plane[NORMAL + c]
        for c in range(3):
            plane[FIRST_NORMAL + 3 * half + c] = vectors[c, 0] if dot >= 0.0 else -vectors[c, 0]
    _mean_and_covariance(sums[0] + sums[1], total, m, plane)
    # The moments are relative to the centre of the voxel, whose three indices the key contains (``pack``).
    mask = (1 << 21) - 1
    plane[0] += ((key >> 42) - _OFFSET + 0.5) * voxel
    plane[1] += (((key >> 21) & mask) - _OFFSET + 0.5) * voxel
    plane[2] += ((key & mask) - _OFFSET + 0.5) * voxel
    plane[VARIANCE] = variance


@njit(cache=True)
def _mean_and_covariance(
    s: FloatArray, n: float, m: FloatArray, plane: FloatArray
) -> None:  # pragma: no cover - compiled
    """Write the mean to the first columns of ``plane``, and the lower half of the covariance to ``m``."""
    x, y, z = s[0] / n, s[1] / n, s[2] / n
    plane[0], plane[1], plane[2] = x, y, z
    m[0, 0] = s[3] / n - x * x
    m[1, 0] = s[4] / n - x * y
    m[2, 0] = s[5] / n - x * z
    m[1, 1] = s[6] / n - y * y
    m[2, 1] = s[7] / n - y * z
    m[2, 2] = s[8] / n - z * z


@njit(cache=True)
def copy_near(
    table: VoxelTable, target: VoxelTable, centre: FloatArray, radius: float, voxel: float
) -> None:  # pragma: no cover
    """Copy the voxels within ``radius`` of ``centre`` to the empty table ``target``."""
    mask = (1 << 21) - 1
    for row in range(len(table.keys)):
        key = table.keys[row]
        if key == EMPTY:
            continue
        x = ((key >> 42) - _OFFSET + 0.5) * voxel - centre[0]
        y = (((key >> 21) & mask) - _OFFSET + 0.5) * voxel - centre[1]
        z = ((key & mask) - _OFFSET + 0.5) * voxel - centre[2]
        if x * x + y * y + z * z > radius * radius:
            continue
        new_row = row_of(target.keys, key)
        target.keys[new_row] = key
        target.counts[new_row] = table.counts[row]
        target.sums[new_row] = table.sums[row]
        target.planes[new_row] = table.planes[row]
        target.used[0] += 1

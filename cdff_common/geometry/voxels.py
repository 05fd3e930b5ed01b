# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Downsampling of clouds by voxels: one mean point per occupied voxel."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray

Int = NDArray[np.int64]

#: Steps of the search for a voxel size, and relative deviation from the number of points at which it ends.
_SEARCH_STEPS = 16
_TOLERANCE = 0.1
#: 2^64 over the golden ratio: distributes keys over the table (Knuth, TAOCP 3, 6.4).
_SPREAD = np.uint64(0x9E3779B97F4A7C15)


def voxel_means(points_m: FloatArray, voxel_m: float) -> FloatArray:
    """Return the mean ``(m, 3)`` of the points ``(n, 3)`` of each occupied voxel, in the order of the voxels.

    The grid is at multiples of ``voxel_m`` from the lowest corner of the cloud.

    Raises
    ------
    InputError
        If the voxels are so small for the extent that their index does not fit 62 bits.
    """
    voxel, keys = voxel_rows(points_m, voxel_m)
    return _means(np.ascontiguousarray(points_m, dtype=np.float64), voxel, np.argsort(keys))


def voxel_rows(points_m: FloatArray, voxel_m: float) -> tuple[Int, Int]:
    """Return the voxel number of each point ``(n,)``, by first appearance, and the keys ``(m,)`` of the
    voxels.

    Keys ascend with x, then y, then z of the voxels; raises InputError if they do not fit 62 bits.
    """
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    if not len(points):
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    low, high = extent(points)
    return _number_voxels(points, low, voxel_m, _size(low, high, voxel_m), len(points))


def voxel_for(points_m: FloatArray, target_count: int) -> float:
    """Return the voxel edge, metres, with about ``target_count`` occupied voxels (within 10 %); 0 for fewer
    points.

    The number of occupied voxels is about a power of the edge: secant steps in logarithms, inside a bracket.
    """
    return _search_voxel(np.ascontiguousarray(points_m, dtype=np.float64), target_count)[0]


def downsampled(points_m: FloatArray, target_count: int) -> tuple[FloatArray, float]:
    """Return ``voxel_means`` with about ``target_count`` points, and the voxel edge; 0 if all points are
    kept.
    """
    points = np.ascontiguousarray(points_m, dtype=np.float64)
    voxel_m, rows_and_keys = _search_voxel(points, target_count)
    if rows_and_keys is None:
        return (points if voxel_m == 0.0 else voxel_means(points, voxel_m)), voxel_m
    voxel, keys = rows_and_keys
    return _means(points, voxel, np.argsort(keys)), voxel_m


def _search_voxel(points: FloatArray, target_count: int) -> tuple[float, tuple[Int, Int] | None]:
    """Return the edge of the voxels, and their ``voxel_rows`` if the search computed them."""
    if len(points) <= target_count:
        return 0.0, None
    floor, ceiling = extent(points)
    extent_m = float(np.max(ceiling - floor))
    if extent_m == 0.0:
        return 0.0, None
    low, high = extent_m * 1e-4, extent_m
    voxel_m, exponent, previous = extent_m / np.sqrt(8.0 * target_count), 2.0, (0.0, 0)
    for _ in range(_SEARCH_STEPS):
        rows_and_keys = _number_voxels(
            points, floor, voxel_m, _size(floor, ceiling, voxel_m), 2 * target_count
        )
        occupied = min(len(rows_and_keys[1]), 2 * target_count)
        if abs(occupied - target_count) <= _TOLERANCE * target_count:
            return float(voxel_m), rows_and_keys
        low, high = (voxel_m, high) if occupied > target_count else (low, voxel_m)
        if previous[1] not in (0, occupied) and max(previous[1], occupied) < 2 * target_count:
            exponent = np.log(previous[1] / occupied) / np.log(voxel_m / previous[0])
        previous = voxel_m, occupied
        voxel_m *= (occupied / target_count) ** (1.0 / min(max(exponent, 0.5), 3.0))
        voxel_m = voxel_m if low < voxel_m < high else np.sqrt(low * high)
    return float(voxel_m), None


def _size(low: FloatArray, high: FloatArray, voxel_m: float) -> Int:
    """Return the number of voxels along each axis."""
    size = [int(n) + 1 for n in np.floor((high - low) / voxel_m)]
    if size[0] * size[1] * size[2] >= 1 << 62:
        raise InputError(f"voxel_m={voxel_m}: too small for a cloud of {high - low} m")
    return np.array(size)


@njit(cache=True)
def extent(points: FloatArray) -> tuple[FloatArray, FloatArray]:  # pragma: no cover - compiled
    """Return the lowest and highest corner (3,) of finite points (n, 3), n at least 1."""
    low, high = points[0].copy(), points[0].copy()
    for i in range(1, len(points)):
        for c in range(3):
            low[c], high[c] = min(low[c], points[i, c]), max(high[c], points[i, c])
    return low, high


@njit(cache=True)
def _number_voxels(
    points: FloatArray, low: FloatArray, voxel: float, size: Int, limit: int
) -> tuple[Int, Int]:  # pragma: no cover - compiled
    """Number voxels by first appearance until there are more than ``limit``.

    Hash table with open addressing: the slot of a key holds the number of its voxel. The table starts small,
    so that it fits the cache, and grows with the number of voxels.
    """
    n, inverse = len(points), 1.0 / voxel
    bits = 12
    slot = np.full(1 << bits, -1, np.int32)
    keys, row = np.empty(1 << (bits - 1), np.int64), np.empty(n, np.int64)
    count = 0
    for i in range(n):
        x = np.int64((points[i, 0] - low[0]) * inverse)
        y = np.int64((points[i, 1] - low[1]) * inverse)
        z = np.int64((points[i, 2] - low[2]) * inverse)
        key = (x * size[1] + y) * size[2] + z
        at = _slot(slot, keys, key, bits)
        if slot[at] < 0:
            if count == limit:
                return row, keys
            if count == len(keys):
                bits += 2
                slot = np.full(1 << bits, -1, np.int32)
                larger = np.empty(1 << (bits - 1), np.int64)
                larger[:count] = keys
                keys = larger
                for j in range(count):
                    slot[_slot(slot, keys, keys[j], bits)] = j
                at = _slot(slot, keys, key, bits)
            slot[at] = count
            keys[count] = key
            count += 1
        row[i] = slot[at]
    return row, keys[:count].copy()


@njit(cache=True, inline="always")
def _slot(slot: NDArray[np.int32], keys: Int, key: int, bits: int) -> int:  # pragma: no cover - compiled
    """Return the slot of a key."""
    last = (1 << bits) - 1
    at = np.int64((np.uint64(key) * _SPREAD) >> np.uint64(64 - bits))
    while slot[at] >= 0 and keys[slot[at]] != key:
        at = (at + 1) & last
    return int(at)


@njit(cache=True)
def _means(points: FloatArray, row: Int, order: Int) -> FloatArray:  # pragma: no cover - compiled
    """Return the means (k, 3) of the points of each voxel.

    ``row`` (n,) is the voxel number of each point, and ``order`` (k,) lists the voxel numbers in the order
    of the result.
    """
    total, count, rank = np.zeros((len(order), 3)), np.zeros(len(order)), np.empty(len(order), np.int64)
    rank[order] = np.arange(len(order))
    for i in range(len(points)):
        j = rank[row[i]]
        count[j] += 1.0
        for c in range(3):
            total[j, c] += points[i, c]
    for j in range(len(order)):
        for c in range(3):
            total[j, c] /= count[j]
    return total

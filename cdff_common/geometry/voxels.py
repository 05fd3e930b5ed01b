# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Thinning of clouds by voxels: one mean point per occupied voxel."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray

_SEARCH_STEPS = 16
_WITHIN = 0.05


def voxel_means(points_m: FloatArray, voxel_m: float) -> FloatArray:
    """Mean ``(m, 3)`` of the points ``(n, 3)`` of each occupied voxel, in the order of the voxels.

    The grid lies on multiples of ``voxel_m`` from the cloud's lowest corner.

    Raises
    ------
    InputError
        If the voxels are so small for the extent that their index does not fit 62 bits.
    """
    _, voxel, count = np.unique(_keys(points_m, voxel_m), return_inverse=True, return_counts=True)
    return np.stack([np.bincount(voxel, weights=points_m[:, axis]) / count for axis in range(3)], axis=1)


def voxel_for(points_m: FloatArray, wanted: int) -> float:
    """Edge of voxels of which about ``wanted`` are occupied (within 5 %), metres; 0 where there are not more points.

    The number occupied falls with the edge, so the logarithm of the edge is bisected.
    """
    extent_m = float(np.ptp(points_m, axis=0).max()) if len(points_m) else 0.0
    if len(points_m) <= wanted or extent_m == 0.0:
        return 0.0
    low, high = extent_m * 1e-4, extent_m
    voxel_m = high
    for _ in range(_SEARCH_STEPS):
        voxel_m = float(np.sqrt(low * high))
        occupied = len(np.unique(_keys(points_m, voxel_m)))
        if abs(occupied - wanted) <= _WITHIN * wanted:
            break
        low, high = (voxel_m, high) if occupied > wanted else (low, voxel_m)
    return voxel_m


def _keys(points_m: FloatArray, voxel_m: float) -> NDArray[np.int64]:
    """One integer per voxel."""
    cells = np.floor((points_m - points_m.min(axis=0)) / voxel_m)
    size = [int(n) + 1 for n in cells.max(axis=0)]
    if size[0] * size[1] * size[2] >= 1 << 62:
        raise InputError(f"voxel_m={voxel_m}: too small for a cloud of {np.ptp(points_m, axis=0)} m")
    c = cells.astype(np.int64)
    return np.asarray((c[:, 0] * size[1] + c[:, 1]) * size[2] + c[:, 2], dtype=np.int64)

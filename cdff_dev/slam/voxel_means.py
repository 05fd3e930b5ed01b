# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Means of points in voxels, which are added in parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

#: Number of voxels above which their edge is doubled.
_MAX_VOXELS = 4_000_000
#: Bits of a key for the index along each axis.
_BITS = 21


class VoxelMeans:
    """Mean position and value of the points in each voxel.

    Parameters
    ----------
    edge_m : float
        Edge of a voxel, metres; it is doubled when there are more than 4 million voxels.
    """

    def __init__(self, edge_m: float) -> None:
        self.edge_m = edge_m
        #: Rows with the sums of x, y, z and value, and the number of points; and those not merged yet.
        self._sums = np.zeros((0, 5))
        self._pending: list[NDArray[np.float64]] = []

    def add(self, points_m: ArrayLike, values: ArrayLike) -> None:
        """Add points ``(n, 3)`` with values ``(n,)``."""
        points, column = np.asarray(points_m, np.float64), np.asarray(values, np.float64)
        rows = np.column_stack([points, column, np.ones(len(points))])
        self._pending.append(self._sum_voxels(rows))
        if sum(map(len, self._pending)) > max(len(self._sums), 100_000):
            self._merge()

    def means(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the means ``(m, 3)``, ordered by voxel, and their values ``(m,)``."""
        self._merge()
        return self._sums[:, :3] / self._sums[:, 4:], self._sums[:, 3] / self._sums[:, 4]

    def _merge(self) -> None:
        self._sums, self._pending = self._sum_voxels(np.concatenate([self._sums, *self._pending])), []
        while len(self._sums) > _MAX_VOXELS:
            self.edge_m *= 2.0
            self._sums = self._sum_voxels(self._sums)

    def _sum_voxels(self, sums: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums of all rows of each voxel."""
        index = np.floor(sums[:, :3] / (sums[:, 4:] * self.edge_m)).astype(np.int64) + (1 << (_BITS - 1))
        x, y, z = index.clip(0, (1 << _BITS) - 1).T
        _, voxel = np.unique((x << (2 * _BITS)) | (y << _BITS) | z, return_inverse=True)
        return np.column_stack([np.bincount(voxel, weights=column) for column in sums.T])

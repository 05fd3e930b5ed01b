# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Local map of planes in voxels of several sizes, which moves with the sensor."""

from __future__ import annotations

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_core.dfns.scan_to_map_registration import _voxel_table
from cdff_core.dfns.scan_to_map_registration._voxel_table import VoxelTable

#: Initial number of rows of the voxel table, and the fraction of used rows above which it is rebuilt.
_INITIAL_CAPACITY, _MAX_LOAD = 1 << 15, 0.6
#: Maximum number of points of a voxel: more would hardly change its plane.
_MAX_VOXEL_POINTS = 60


class VoxelMap:
    """One voxel table for each size, each size twice the previous one.

    Parameters
    ----------
    voxel_m : float
        Edge of the smallest voxels, metres.
    levels : int
        Number of sizes.
    radius_m : float
        Distance from the sensor beyond which voxels may be removed, metres.
    """

    def __init__(self, voxel_m: float, levels: int, radius_m: float) -> None:
        self.voxel_m, self._radius_m = voxel_m, radius_m
        self.tables = tuple(_voxel_table.empty_table(_INITIAL_CAPACITY) for _ in range(levels))

    @property
    def voxels(self) -> int:
        """Number of the smallest voxels."""
        return int(self.tables[0].used[0])

    @property
    def memory_bytes(self) -> int:
        """Memory of all tables."""
        return sum(column.nbytes for table in self.tables for column in table)

    def add(self, points: FloatArray, centre: FloatArray) -> None:
        """Add points (n, 3) within the radius around ``centre`` (3,).

        Voxels beyond the radius are removed when a table is full; if it is still full, its capacity is
        doubled.
        """
        points = points[np.sum((points - centre) ** 2, axis=1) < self._radius_m**2]
        self.tables = tuple(
            self._with_points(table, points, self.voxel_m * (1 << level), centre)
            for level, table in enumerate(self.tables)
        )

    def _with_points(
        self, table: VoxelTable, points: FloatArray, voxel_m: float, centre: FloatArray
    ) -> VoxelTable:
        """Return the table with points added; it is a new table if they did not fit."""
        capacity = len(table.keys)
        # Each point may create a voxel, and the compiled loop cannot enlarge the table.
        if table.used[0] + len(points) > _MAX_LOAD * capacity:
            table = self._rebuilt_table(table, capacity, voxel_m, centre)
            if table.used[0] + len(points) > _MAX_LOAD * capacity:
                table = self._rebuilt_table(table, 2 * capacity, voxel_m, centre)
        _voxel_table.add(table, points, voxel_m, _MAX_VOXEL_POINTS)
        return table

    def _rebuilt_table(
        self, table: VoxelTable, capacity: int, voxel_m: float, centre: FloatArray
    ) -> VoxelTable:
        target = _voxel_table.empty_table(capacity)
        _voxel_table.copy_near(table, target, np.ascontiguousarray(centre), self._radius_m, voxel_m)
        return target

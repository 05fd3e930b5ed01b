# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One mean point per occupied voxel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_downsampling._interface import (
    PointCloudDownsamplingInputs,
    PointCloudDownsamplingInterface,
    PointCloudDownsamplingOutputs,
)

_SEARCH_STEPS = 16


class VoxelGridConfig(DfnConfig):
    """Size of the voxels, or number of points wanted."""

    voxel_m: float | None = Field(None, gt=0.0, description="Edge of a voxel, metres; absent: from max_points")
    max_points: int = Field(25_000, ge=10, le=10_000_000, description="Points wanted where voxel_m is absent")


class VoxelGrid(PointCloudDownsamplingInterface):
    """Average the points of each voxel of a grid on multiples of its edge from the cloud's lowest corner."""

    Config: ClassVar[type[DfnConfig]] = VoxelGridConfig

    def process(self, inputs: PointCloudDownsamplingInputs) -> PointCloudDownsamplingOutputs:
        """Return the thinned cloud and the voxel size; raises InputError on a malformed cloud."""
        p = checked_points(inputs.points)
        if self.config.voxel_m is not None:
            voxel_m = self.config.voxel_m
        elif len(p) <= self.config.max_points or not np.any(np.ptp(p, axis=0)):
            return PointCloudDownsamplingOutputs(points=p, voxel_m=np.array(0.0))
        else:
            voxel_m = self._voxel_for(p)
        key = _keys(p, voxel_m)
        _, voxel, count = np.unique(key, return_inverse=True, return_counts=True)
        mean = np.stack([np.bincount(voxel, weights=p[:, axis]) / count for axis in range(3)], axis=1)
        return PointCloudDownsamplingOutputs(points=mean, voxel_m=np.array(voxel_m))

    def _voxel_for(self, points_m: NDArray[np.float64]) -> float:
        """Bisect the logarithm of the edge until the number of occupied voxels is within 5 % of the wanted one."""
        wanted = self.config.max_points
        extent_m = float(np.ptp(points_m, axis=0).max())
        low, high = extent_m * 1e-4, extent_m
        for _ in range(_SEARCH_STEPS):
            voxel_m = float(np.sqrt(low * high))
            occupied = len(np.unique(_keys(points_m, voxel_m)))
            if abs(occupied - wanted) <= 0.05 * wanted:
                break
            low, high = (voxel_m, high) if occupied > wanted else (low, voxel_m)
        return voxel_m


def _keys(points_m: NDArray[np.float64], voxel_m: float) -> NDArray[np.int64]:
    """One integer per voxel."""
    cells = np.floor((points_m - points_m.min(axis=0)) / voxel_m)
    size = [int(n) + 1 for n in cells.max(axis=0)]
    if size[0] * size[1] * size[2] >= 1 << 62:
        raise InputError(f"voxel_m={voxel_m}: too small for a cloud of {np.ptp(points_m, axis=0)} m")
    c = cells.astype(np.int64)
    return (c[:, 0] * size[1] + c[:, 1]) * size[2] + c[:, 2]

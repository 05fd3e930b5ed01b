# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One mean point per occupied voxel."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_downsampling._interface import (
    PointCloudDownsamplingInputs,
    PointCloudDownsamplingInterface,
    PointCloudDownsamplingOutputs,
)


class VoxelGridConfig(DfnConfig):
    """Size of the voxels, or number of points wanted."""

    voxel_m: float | None = Field(None, gt=0.0, description="Edge of a voxel, metres; absent: from max_points")
    max_points: int = Field(25_000, ge=10, le=10_000_000, description="Points wanted where voxel_m is absent")


class VoxelGrid(PointCloudDownsamplingInterface):
    """Average the points of each voxel of a grid on multiples of its edge from the cloud's lowest corner."""

    Config: ClassVar[type[DfnConfig]] = VoxelGridConfig

    def setup(self) -> None:
        """Compile, so that the first cloud is as fast as the others; a read-only array is another type to it."""
        from cdff_common.geometry.voxels import voxel_means

        for writeable in (True, False):
            points = np.zeros((1, 3))
            points.setflags(write=writeable)
            voxel_means(points, 1.0)

    def process(self, inputs: PointCloudDownsamplingInputs) -> PointCloudDownsamplingOutputs:
        """Return the thinned cloud and the voxel size; raises InputError on a malformed cloud."""
        from cdff_common.geometry.voxels import thinned, voxel_means

        p = checked_points(inputs.points)
        if inputs.edge_m is not None:
            voxel_m = float(inputs.edge_m)
            if not (np.isfinite(voxel_m) and voxel_m > 0.0):
                raise InputError(f"edge_m={voxel_m}: expected metres above 0")
        elif self.config.voxel_m is not None:
            voxel_m = self.config.voxel_m
        else:
            points, voxel_m = thinned(p, self.config.max_points)
            return PointCloudDownsamplingOutputs(points=points, voxel_m=np.array(voxel_m))
        return PointCloudDownsamplingOutputs(points=voxel_means(p, voxel_m), voxel_m=np.array(voxel_m))

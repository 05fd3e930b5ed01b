# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Downsampling to the mean point of each occupied voxel."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.points import checked_points
from cdff_common.geometry.voxels import downsampled, voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_downsampling.interface import Inputs, Interface, Outputs


class VoxelGridConfig(DfnConfig):
    """Parameters of VoxelGrid."""

    voxel_m: float | None = Field(None, gt=0, description="Edge of a voxel; absent: from max_points")
    max_points: int = Field(
        25_000,
        ge=10,
        le=10_000_000,
        description="Desired number of points if voxel_m is absent, reached within 10 %",
    )


class VoxelGrid(Interface[VoxelGridConfig]):
    """Average the points of each voxel of a grid that starts at the lowest corner of the cloud."""

    def setup(self) -> None:
        """Compile the kernels for writeable and for read-only arrays, which are different types for numba."""
        for writeable in (True, False):
            points = np.zeros((1, 3))
            points.setflags(write=writeable)
            voxel_means(points, 1.0)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the downsampled cloud and the voxel size; raises InputError on a malformed cloud."""
        p = checked_points(inputs.points)
        voxel_m = inputs.edge_m or self.config.voxel_m
        if voxel_m is not None:
            return Outputs(points=voxel_means(p, voxel_m), voxel_m=voxel_m)
        points, voxel_m = downsampled(p, self.config.max_points)
        return Outputs(points=points, voxel_m=voxel_m)

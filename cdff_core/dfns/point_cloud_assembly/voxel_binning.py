# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One mean point per voxel of both clouds."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_assembly._interface import (
    PointCloudAssemblyInputs,
    PointCloudAssemblyInterface,
    PointCloudAssemblyOutputs,
)
from cdff_core.dfns.point_cloud_assembly._view import in_view


class VoxelBinningConfig(DfnConfig):
    """Size of the voxels."""

    voxel_m: float = Field(0.1, gt=0.0, le=1000.0, description="Edge of a voxel, metres")


class VoxelBinning(PointCloudAssemblyInterface):
    """Average the points of both clouds in each voxel."""

    Config: ClassVar[type[DfnConfig]] = VoxelBinningConfig

    def process(self, inputs: PointCloudAssemblyInputs) -> PointCloudAssemblyOutputs:
        """Return the joined cloud; raises InputError on malformed clouds or an empty view."""
        from cdff_common.geometry.voxels import voxel_means

        return PointCloudAssemblyOutputs(voxel_means(np.vstack(in_view(inputs)), self.config.voxel_m))

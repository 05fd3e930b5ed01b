# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assembly by averaging the points of both clouds in each voxel."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_assembly._view import crop_to_view
from cdff_core.dfns.point_cloud_assembly.interface import Inputs, Interface, Outputs


class VoxelBinningConfig(DfnConfig):
    """Parameters of VoxelBinning."""

    voxel_m: float = Field(
        0.1, gt=0, le=1000, description="Edge of a voxel; its points are replaced by their mean"
    )


class VoxelBinning(Interface[VoxelBinningConfig]):
    """Average the points of both clouds in each voxel."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the joined cloud; raises InputError as ``crop_to_view``."""
        return Outputs(assembled_points=voxel_means(np.vstack(crop_to_view(inputs)), self.config.voxel_m))

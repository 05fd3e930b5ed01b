# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""One mean point per voxel of both clouds."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.voxels import voxel_means
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.point_cloud_assembly._view import in_view
from cdff_core.dfns.point_cloud_assembly.interface import Inputs, Interface, Outputs


class VoxelBinningConfig(DfnConfig):
    """Parameters of VoxelBinning."""

    voxel_m: float = Field(0.1, gt=0, le=1000, description="Edge of a voxel, of which one mean point is kept")


class VoxelBinning(Interface[VoxelBinningConfig]):
    """Average the points of both clouds in each voxel."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the joined cloud; raises InputError on malformed clouds or an empty view."""
        return Outputs(assembled_points=voxel_means(np.vstack(in_view(inputs)), self.config.voxel_m))

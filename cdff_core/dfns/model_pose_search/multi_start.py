# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Registration from starts on all sides of the model."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.model_pose_search.interface import Inputs, Interface, Outputs
from cdff_core.object_models.hypotheses import SurfaceModel, find_hypotheses
from cdff_core.object_models.nearest_grid import NearestGrid

#: Least number of points: one for each unknown of a pose.
_MIN_POINTS = 6


class MultiStartConfig(DfnConfig):
    """Parameters of MultiStart."""

    rolls: int = Field(
        10, ge=4, le=72, description="Rotations about the line of sight of each view of the model"
    )
    hypotheses: int = Field(60, ge=1, le=500, description="Largest number of poses")
    seed: int = Field(0, ge=0, le=2**31, description="Seed of the choice of points of the scan")


class MultiStart(Interface[MultiStartConfig]):
    """Point-to-plane registration of a part of the scan from each view and roll; the best are continued."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return distinct poses, best first; raises InputError."""
        if len(inputs.scan) < _MIN_POINTS:
            raise InputError(f"scan of {len(inputs.scan)} points, expected at least {_MIN_POINTS}")
        surface = SurfaceModel(
            np.ascontiguousarray(inputs.points, np.float64),
            np.ascontiguousarray(inputs.normals, np.float64),
            NearestGrid(inputs.grid_index, inputs.grid_low, inputs.grid_cell_m),
            inputs.diameter_m,
        )
        poses, costs = find_hypotheses(
            inputs.scan,
            surface,
            inputs.view_directions,
            inputs.view_centroids,
            rolls=self.config.rolls,
            count=self.config.hypotheses,
            sigma_m=inputs.sigma_m,
            seed=self.config.seed,
        )
        return Outputs(poses=poses, costs=costs)

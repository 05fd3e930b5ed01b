# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Preparation of a model from views on all its sides."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.model_preparation.interface import Inputs, Interface, Outputs
from cdff_core.object_models.model import PreparationConfig, prepare_model


class VisibleSurfaceConfig(PreparationConfig, DfnConfig):
    """Parameters of VisibleSurface."""

    seed: int = Field(0, ge=0, le=2**31, description="Seed of the choice of the points")


class VisibleSurface(Interface[VisibleSurfaceConfig]):
    """The parts of the mesh that a z-buffer shows from at least 60 directions."""

    def process(self, inputs: Inputs) -> Outputs:
        """Return the prepared model; raises InputError or DegenerateGeometryError."""
        model = prepare_model(inputs.vertices, inputs.triangles, self.config, self.config.seed)
        return Outputs(
            drawn_vertices=model.vertices_m,
            drawn_triangles=model.triangles,
            points=model.surface.points_m,
            normals=model.surface.normals,
            grid_index=model.grid.rows,
            grid_low=model.grid.low_m,
            grid_cell_m=model.grid.cell_m,
            view_directions=model.surface.view_directions,
            view_centroids=model.surface.view_centroids_m,
            symmetries=model.symmetry.transforms,
            centre_m=model.surface.centre_m,
            diameter_m=model.diameter_m,
        )

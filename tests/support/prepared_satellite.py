# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The satellite prepared by ModelPreparation, once for all tests."""

from __future__ import annotations

from functools import cache
from typing import Any

from cdff_core.dfns.model_preparation.interface import ModelPreparationInputs, ModelPreparationOutputs
from cdff_core.dfns.model_preparation.visible_surface import VisibleSurface
from tests.support import satellite


@cache
def prepared() -> ModelPreparationOutputs:
    """Return the prepared satellite."""
    node = VisibleSurface()
    node.configure({"points": 6000, "views": 60, "view_pixels": 96, "grid_cells": 64})
    vertices, triangles = satellite.satellite()
    return node.process(ModelPreparationInputs(vertices=vertices, triangles=triangles))


def surface_ports() -> dict[str, Any]:
    """Return the inputs of ModelPoseSearch and ModelPoseRefinement that describe the surface."""
    model = prepared()
    names = ("points", "normals", "grid_index", "grid_low", "grid_cell_m", "diameter_m")
    return {name: getattr(model, name) for name in names}

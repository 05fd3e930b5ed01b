# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normals from the principal axes of each neighbourhood."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from pydantic import Field

from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.normals_estimation._interface import (
    NormalsEstimationInputs,
    NormalsEstimationInterface,
    NormalsEstimationOutputs,
)


class PrincipalAxisConfig(DfnConfig):
    """Size of a neighbourhood and where it is seen from."""

    neighbours: int = Field(12, ge=4, le=200, description="Points of a neighbourhood, itself included")
    viewpoint_m: tuple[float, float, float] = Field((0.0, 0.0, 0.0), description="Normals are turned to it, metres")


class PrincipalAxis(NormalsEstimationInterface):
    """The normal is the axis of least variance of the nearest neighbours.

    Hoppe et al. (1992), "Surface reconstruction from unorganized points", doi:10.1145/133994.134011.
    """

    Config: ClassVar[type[DfnConfig]] = PrincipalAxisConfig

    def process(self, inputs: NormalsEstimationInputs) -> NormalsEstimationOutputs:
        """Return unit normals and roughness; raises InputError on a malformed or too small cloud."""
        from cdff_common.geometry.kdtree import kd_tree
        from cdff_common.geometry.plane_fits import plane_fits

        p = checked_points(inputs.points, least=self.config.neighbours)
        normals, _, variance = plane_fits(kd_tree(p), self.config.neighbours)
        away = np.einsum("ni,ni->n", normals, np.asarray(self.config.viewpoint_m) - p) < 0.0
        normals[away] *= -1.0
        return NormalsEstimationOutputs(normals=normals, roughness_m=np.sqrt(variance[:, 0]))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Normals from the principal axes of the neighbourhood of each point."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.geometry.kdtree import kd_tree
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.normals_estimation.interface import Inputs, Interface, Outputs


class PrincipalAxisConfig(DfnConfig):
    """Parameters of PrincipalAxis."""

    neighbours: int = Field(
        12, ge=4, le=200, description="Number of points of a neighbourhood, including its centre"
    )
    viewpoint_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Point towards which normals are oriented"
    )


class PrincipalAxis(Interface[PrincipalAxisConfig]):
    """The normal is the axis of least variance of the nearest neighbours.

    Hoppe et al. (1992), "Surface reconstruction from unorganized points", doi:10.1145/133994.134011.
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return unit normals and roughness; raises InputError on a malformed or too small cloud."""
        p = checked_points(inputs.points, least=self.config.neighbours)
        normals, _, variance = plane_fits(kd_tree(p), self.config.neighbours)
        points_away = np.einsum("ni,ni->n", normals, np.asarray(self.config.viewpoint_m) - p) < 0.0
        normals[points_away] *= -1.0
        return Outputs(normals=normals, roughness_m=np.sqrt(variance[:, 0]))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Harris corners of a surface: keypoints where its normals turn in every direction."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.geometry.points import checked_points
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_3d._interface import (
    FeaturesExtraction3DInputs,
    FeaturesExtraction3DInterface,
    FeaturesExtraction3DOutputs,
)
from cdff_core.dfns.features_extraction_3d._scale import ScaleConfig, scale_m


class HarrisConfig(ScaleConfig):
    """Neighbourhoods, and what is a corner."""

    radius_spacings: float = Field(6.0, ge=1.0, le=200.0, description="Radius in median point spacings")
    neighbours: int = Field(12, ge=4, le=200, description="Points of the planes whose normals are compared")
    least_response: float = Field(1e-4, ge=0.0, le=1.0, description="Response below which there is no corner")
    sensitivity: float = Field(0.04, ge=0.0, le=0.25, description="Harris' k: how much edges are held against")
    suppression: float = Field(0.67, gt=0.0, le=10.0, description="Radius of non-maximum suppression, in radii")


class Harris(FeaturesExtraction3DInterface):
    """Points where ``det(C) - k trace(C)^3`` of the mean outer product C of the normals around is the greatest.

    Harris, Stephens (1988), doi:10.5244/C.2.23, with the normals of the neighbourhood in place of image gradients, as
    PCL does it (Sipiran, Bustos 2011, doi:10.1007/s00371-011-0610-y, fit a surface instead). In three dimensions the
    determinant is of the third degree, so the trace is taken to its third power: both are then free of scale; the
    trace of unit normals is 1. A plane has a response below 0, so has an edge, a corner where three faces meet up to
    ``1/27 - k``: hence k is in units of that, ``k / 27``.
    """

    Config: ClassVar[type[DfnConfig]] = HarrisConfig

    def setup(self) -> None:
        """Compile the kernels, so that the first call costs what the others do."""
        x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
        self.process(FeaturesExtraction3DInputs(np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)))

    def process(self, inputs: FeaturesExtraction3DInputs) -> FeaturesExtraction3DOutputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        from cdff_common.geometry.kdtree import kd_tree
        from cdff_common.geometry.neighbours import radius_neighbours
        from cdff_common.geometry.plane_fits import plane_fits
        from cdff_core.dfns.features_extraction_3d._harris_kernels import normal_scatters
        from cdff_core.dfns.features_extraction_3d._iss_kernels import greatest_around

        cfg: Any = self.config
        p = checked_points(inputs.points, least=cfg.neighbours)
        radius_m = scale_m(p, inputs.radius_m, cfg)
        normals, *_ = plane_fits(kd_tree(p), cfg.neighbours)
        start, index = radius_neighbours(p, p, radius_m)
        response = self._response(normal_scatters(normals, start, index))
        corners = np.flatnonzero(response > cfg.least_response)
        start, index = radius_neighbours(p, p[corners], cfg.suppression * radius_m)
        chosen = corners[greatest_around(response, corners, start, index)]
        if len(chosen) > cfg.max_keypoints:
            chosen = chosen[np.argsort(-response[chosen], kind="stable")[: cfg.max_keypoints]]
        indices = np.sort(chosen)
        return FeaturesExtraction3DOutputs(keypoints=p[indices], indices=indices)

    def _response(self, scatter: NDArray[np.float64]) -> NDArray[np.float64]:
        trace = np.trace(scatter, axis1=1, axis2=2)
        return np.asarray(np.linalg.det(scatter) - self.config.sensitivity / 27.0 * trace**3)

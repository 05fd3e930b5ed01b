# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Harris corners of a surface: keypoints whose neighbourhood has normals in all directions."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import FloatArray
from cdff_common.geometry.kdtree import kd_tree
from cdff_common.geometry.neighbours import radius_neighbours
from cdff_common.geometry.plane_fits import plane_fits
from cdff_common.geometry.points import checked_points
from cdff_core.dfns.features_extraction_3d._kernels import normal_scatters
from cdff_core.dfns.features_extraction_3d._scale import SalienceConfig, scale_m, select_most_salient
from cdff_core.dfns.features_extraction_3d.interface import Inputs, Interface, Outputs


class HarrisConfig(SalienceConfig):
    """Parameters of Harris."""

    neighbours: int = Field(
        12, ge=4, le=200, description="Number of points to which the plane of a normal is fitted"
    )
    least_response: float = Field(1e-4, ge=0, le=1, description="Minimum response of a corner")
    sensitivity: float = Field(
        0.04, ge=0, le=0.25, description="Harris parameter k in units of 1/27; larger values suppress edges"
    )


class Harris(Interface[HarrisConfig]):
    """Local maxima of ``det(C) - k trace(C)^3``, C the mean outer product of the surrounding normals.

    Harris, Stephens (1988), doi:10.5244/C.2.23, with the normals of the neighbourhood instead of image
    gradients, as in PCL (Sipiran, Bustos 2011, doi:10.1007/s00371-011-0610-y, fit a surface instead). In
    three dimensions the determinant is of third degree, so the trace is cubed; the trace for unit normals is
    1. Planes and edges have a negative response. A corner of three faces has a response of at most ``1/27 -
    k``, therefore the parameter ``sensitivity`` is k in units of 1/27.
    """

    def setup(self) -> None:
        """Compile the kernels."""
        x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
        self.process(Inputs(points=np.stack([x.ravel(), y.ravel(), 0.0 * x.ravel()], axis=1)))

    def process(self, inputs: Inputs) -> Outputs:
        """Return the keypoints; raises InputError on a malformed cloud."""
        cfg = self.config
        points = checked_points(inputs.points, least=cfg.neighbours)
        radius_m = scale_m(points, inputs.radius_m, cfg)
        normals, *_ = plane_fits(kd_tree(points), cfg.neighbours)
        start, index = radius_neighbours(points, points, radius_m)
        response = self._response(normal_scatters(normals, start, index))
        return select_most_salient(points, response, cfg.least_response, radius_m, cfg)

    def _response(self, scatter: FloatArray) -> FloatArray:
        """Return the Harris response (n,) of mean outer products of normals (n, 3, 3)."""
        trace = np.trace(scatter, axis1=1, axis2=2)
        return np.asarray(np.linalg.det(scatter) - self.config.sensitivity / 27.0 * trace**3)

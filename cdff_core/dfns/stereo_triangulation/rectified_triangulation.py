# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Triangulation of points of a rectified pair from their disparity."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_triangulation.interface import Inputs, Interface, Outputs
from cdff_core.imaging.rectified_camera import RectifiedCamera


class RectifiedTriangulationConfig(DfnConfig):
    """Parameters of RectifiedTriangulation."""

    sigma_feature_px: float = Field(0.2, gt=0, le=10, description="Standard deviation of column and row")
    sigma_disparity_px: float = Field(0.2, gt=0, le=10, description="Standard deviation of a disparity")


class RectifiedTriangulation(Interface[RectifiedTriangulationConfig]):
    """Triangulate points with depth ``z = fx b / d``, and propagate the noise of the pixels to first order.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §12
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the triangulated points; raises InputError on a disparity that is not above 0."""
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        uvd = np.column_stack([inputs.features, inputs.disparities])
        if len(uvd) and not uvd[:, 2].min() > 0.0:
            raise InputError(f"smallest disparity {uvd[:, 2].min():.3g} px: expected above 0")
        J = camera.triangulation_jacobian(uvd)
        c = self.config
        noise = np.diag([c.sigma_feature_px**2, c.sigma_feature_px**2, c.sigma_disparity_px**2])
        return Outputs(points=camera.triangulate(uvd), covariances=J @ noise @ np.swapaxes(J, 1, 2))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""RectifiedTriangulation: points of a rectified pair by their disparity."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_triangulation._interface import (
    StereoTriangulationInputs,
    StereoTriangulationInterface,
    StereoTriangulationOutputs,
)
from cdff_core.imaging.rectified_camera import RectifiedCamera


class RectifiedTriangulationConfig(DfnConfig):
    """Noise of the measurements."""

    sigma_feature_px: Annotated[float, Field(gt=0, le=10)] = 0.2
    sigma_disparity_px: Annotated[float, Field(gt=0, le=10)] = 0.2


class RectifiedTriangulation(StereoTriangulationInterface):
    """``z = fx b / d``, and first-order propagation of the pixels' noise.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §12
    """

    Config = RectifiedTriangulationConfig
    config: RectifiedTriangulationConfig

    def process(self, inputs: StereoTriangulationInputs) -> StereoTriangulationOutputs:
        """Triangulate every point; raises InputError on a disparity that is not above 0."""
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        uvd = np.column_stack([inputs.features, inputs.disparities])
        if len(uvd) and not uvd[:, 2].min() > 0.0:
            raise InputError(f"smallest disparity {uvd[:, 2].min():.3g} px: expected above 0")
        J = camera.triangulation_jacobian(uvd)
        c = self.config
        noise = np.diag([c.sigma_feature_px**2, c.sigma_feature_px**2, c.sigma_disparity_px**2])
        return StereoTriangulationOutputs(points=camera.triangulate(uvd), covariances=J @ noise @ np.swapaxes(J, 1, 2))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""RectifiedProjection: where known points will appear in a rectified pair."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from cdff_common.geometry import se3
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_prediction_2d._interface import (
    FeaturesPrediction2DInputs,
    FeaturesPrediction2DInterface,
    FeaturesPrediction2DOutputs,
)
from cdff_core.imaging.rectified_camera import RectifiedCamera

_NEAREST_M = 1e-3


class RectifiedProjectionConfig(DfnConfig):
    """Limits of what counts as visible."""

    border_px: Annotated[int, Field(ge=0, le=500)] = 8
    max_magnification: Annotated[float, Field(gt=1, le=10)] = 2.0


class RectifiedProjection(FeaturesPrediction2DInterface):
    """Pinhole projection [1]_; a patch that faces the camera grows by the ratio of its two distances.

    References
    ----------
    .. [1] R. Hartley, A. Zisserman, Multiple View Geometry, 2nd ed., 2004, doi:10.1017/CBO9780511811685, §6.1
    """

    Config = RectifiedProjectionConfig
    config: RectifiedProjectionConfig

    def process(self, inputs: FeaturesPrediction2DInputs) -> FeaturesPrediction2DOutputs:
        """Project the points with the predicted pose."""
        c = self.config
        camera = RectifiedCamera.from_matrix(inputs.camera_matrix, inputs.baseline)
        moved = se3.transform_points(inputs.pose, inputs.points)
        ahead = moved[:, 2] > _NEAREST_M
        moved[~ahead, 2] = _NEAREST_M
        uvd = camera.project(moved)
        rows, columns = inputs.image.shape
        inside = np.all((uvd[:, :2] >= c.border_px) & (uvd[:, :2] < np.array([columns, rows]) - c.border_px), axis=1)
        magnification = np.asarray(inputs.points)[:, 2] / moved[:, 2]
        followed = (magnification <= c.max_magnification) & (magnification >= 1.0 / c.max_magnification)
        return FeaturesPrediction2DOutputs(
            features=np.ascontiguousarray(uvd[:, :2]),
            disparities=np.ascontiguousarray(uvd[:, 2]),
            magnification=magnification,
            visible=ahead & inside & followed,
        )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""GridGftt: good features to track, a share from every cell of a grid."""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from pydantic import Field

from cdff_core.dfns.features_extraction_2d._grid import GridConfig, checked_image, strongest_of_each_cell
from cdff_core.dfns.features_extraction_2d._interface import (
    FeaturesExtraction2DInputs,
    FeaturesExtraction2DInterface,
    FeaturesExtraction2DOutputs,
)

#: From OpenCV's normalised response (gradients times 2 / 255) to (DN/px)^2.
_TO_DN2 = 255.0**2 / 4.0


class GridGfttConfig(GridConfig):
    """Parameters of GridGftt."""

    min_eigenvalue_dn2: Annotated[float, Field(gt=0, le=1e5)] = 1.6
    block_px: Annotated[int, Field(ge=3, le=31)] = 5


class GridGftt(FeaturesExtraction2DInterface):
    """Shi and Tomasi's smaller eigenvalue [1]_; the threshold is what locates a patch to 0.15 px in noise of 2 DN.

    References
    ----------
    .. [1] J. Shi, C. Tomasi, Good Features to Track, CVPR 1994, doi:10.1109/CVPR.1994.323794
    """

    Config = GridGfttConfig
    config: GridGfttConfig

    def process(self, inputs: FeaturesExtraction2DInputs) -> FeaturesExtraction2DOutputs:
        """Detect; raises InputError on anything but a grey uint8 image."""
        c = self.config
        response = cv2.cornerMinEigenVal(checked_image(inputs.image), c.block_px, ksize=3)
        scaled = np.asarray(response, dtype=np.float32) * np.float32(_TO_DN2)
        features, scores = strongest_of_each_cell(scaled, c.min_eigenvalue_dn2, c)
        return FeaturesExtraction2DOutputs(features=features, scores=scores)

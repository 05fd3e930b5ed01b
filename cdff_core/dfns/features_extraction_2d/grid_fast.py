# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""GridFast: FAST corners, a share from every cell of a grid."""

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


class GridFastConfig(GridConfig):
    """Parameters of GridFast."""

    threshold_dn: Annotated[int, Field(ge=1, le=200)] = 10


class GridFast(FeaturesExtraction2DInterface):
    """Rosten and Drummond's segment test on a circle of 16 pixels [1]_: corners by comparisons, without gradients.

    References
    ----------
    .. [1] E. Rosten, R. Porter, T. Drummond, Faster and Better, PAMI 32(1), 2010, doi:10.1109/TPAMI.2008.275
    """

    Config = GridFastConfig
    config: GridFastConfig

    def process(self, inputs: FeaturesExtraction2DInputs) -> FeaturesExtraction2DOutputs:
        """Detect; raises InputError on anything but a grey uint8 image."""
        image = checked_image(inputs.image)
        corners = cv2.FastFeatureDetector.create(self.config.threshold_dn, True).detect(image)
        response = np.zeros(image.shape, np.float32)
        if corners:
            columns, rows = np.rint(cv2.KeyPoint.convert(corners)).astype(np.int64).T
            response[rows, columns] = np.fromiter((corner.response for corner in corners), np.float32, len(corners))
        features, scores = strongest_of_each_cell(response, 0.0, self.config)
        return FeaturesExtraction2DOutputs(features=features, scores=scores)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""FAST corners, the strongest in each cell of a grid."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_core.dfns.features_extraction_2d._grid import GridConfig, select_strongest_per_cell
from cdff_core.dfns.features_extraction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.grey import checked_image


class GridFastConfig(GridConfig):
    """Parameters of GridFast."""

    threshold_dn: int = Field(
        10, ge=1, le=200, description="Minimum grey level difference to the circle around a corner"
    )


class GridFast(Interface[GridFastConfig]):
    """Segment test on a circle of 16 pixels [1]_, which compares grey levels instead of computing gradients.

    References
    ----------
    .. [1] E. Rosten, R. Porter, T. Drummond, Faster and Better, PAMI 32(1), 2010, doi:10.1109/TPAMI.2008.275
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the features; raises InputError on an image that is too small."""
        image = checked_image(inputs.image)
        corners = cv2.FastFeatureDetector.create(self.config.threshold_dn, True).detect(image)
        response = np.zeros(image.shape, np.float32)
        if corners:
            columns, rows = np.rint(cv2.KeyPoint.convert(corners)).astype(np.int64).T
            response[rows, columns] = np.fromiter(
                (corner.response for corner in corners), np.float32, len(corners)
            )
        features, scores = select_strongest_per_cell(response, 0.0, self.config, inputs.mask)
        return Outputs(features=features, scores=scores)

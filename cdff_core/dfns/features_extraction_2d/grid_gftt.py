# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Good features to track, the strongest in each cell of a grid."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_core.dfns.features_extraction_2d._grid import GridConfig, select_strongest_per_cell
from cdff_core.dfns.features_extraction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.grey import checked_image

#: Factor from OpenCV's normalised response, of gradients times 2 / 255, to (DN/px)^2.
_TO_DN2 = 255.0**2 / 4.0


class GridGfttConfig(GridConfig):
    """Parameters of GridGftt."""

    min_eigenvalue_dn2: float = Field(
        1.6,
        gt=0,
        le=1e5,
        description=(
            "Minimum eigenvalue lambda of the structure tensor, (DN/px)^2; with noise sigma and N pixels "
            "in a patch the position of a point is accurate to sigma sqrt(2/(N lambda)) px"
        ),
    )
    block_px: int = Field(5, ge=3, le=31, description="Edge of the window over which gradients are summed")


class GridGftt(Interface[GridGfttConfig]):
    """Smaller eigenvalue of the structure tensor, after Shi and Tomasi [1]_.

    The default threshold locates a patch to 0.15 px for noise of 2 DN.

    References
    ----------
    .. [1] J. Shi, C. Tomasi, Good Features to Track, CVPR 1994, doi:10.1109/CVPR.1994.323794
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the features; raises InputError on an image that is too small."""
        cfg = self.config
        response = cv2.cornerMinEigenVal(checked_image(inputs.image), cfg.block_px, ksize=3)
        scaled = np.asarray(response, dtype=np.float32) * np.float32(_TO_DN2)
        features, scores = select_strongest_per_cell(scaled, cfg.min_eigenvalue_dn2, cfg, inputs.mask)
        return Outputs(features=features, scores=scores)

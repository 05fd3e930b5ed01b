# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SIFT detector: blobs of all sizes with their orientation."""

from __future__ import annotations

import cv2
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.grey import byte_mask, checked_image
from cdff_core.imaging.keypoints import arrays_of


class SiftConfig(DfnConfig):
    """Parameters of Sift."""

    features: int = Field(8000, ge=10, le=50_000, description="Desired number of points over the whole image")
    contrast_threshold: float = Field(
        0.01, gt=0, le=1, description="Minimum contrast of a blob, as a fraction of the white level"
    )


class Sift(Interface[SiftConfig]):
    """Extrema of differences of Gaussians over position and scale [1]_, with sub-pixel accuracy.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the features; raises InputError on an image that is too small."""
        cfg = self.config
        detector = cv2.SIFT.create(cfg.features, contrastThreshold=cfg.contrast_threshold)
        keypoints = detector.detect(checked_image(inputs.image), byte_mask(inputs.mask))
        points, scores, sizes, angles = arrays_of(keypoints)
        return Outputs(features=points, scores=scores, sizes=sizes, angles=angles)

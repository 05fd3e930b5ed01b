# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sift: blobs of every size, with their orientation."""

from __future__ import annotations

from typing import Annotated

import cv2
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_2d._grid import checked_image
from cdff_core.dfns.features_extraction_2d._interface import (
    FeaturesExtraction2DInputs,
    FeaturesExtraction2DInterface,
    FeaturesExtraction2DOutputs,
)
from cdff_core.imaging.keypoints import arrays_of


class SiftConfig(DfnConfig):
    """Parameters of Sift."""

    features: Annotated[int, Field(ge=10, le=50_000)] = 8000
    octave_layers: Annotated[int, Field(ge=1, le=8)] = 3
    contrast_threshold: Annotated[float, Field(gt=0, le=1)] = 0.01
    edge_threshold: Annotated[float, Field(gt=1, le=100)] = 10.0


class Sift(FeaturesExtraction2DInterface):
    """Extrema of differences of Gaussians over position and scale [1]_, to a fraction of a pixel.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    Config = SiftConfig
    config: SiftConfig

    def process(self, inputs: FeaturesExtraction2DInputs) -> FeaturesExtraction2DOutputs:
        """Detect; raises InputError on anything but a grey uint8 image."""
        c = self.config
        detector = cv2.SIFT.create(c.features, c.octave_layers, c.contrast_threshold, c.edge_threshold)
        points, scores, sizes, angles = arrays_of(detector.detect(checked_image(inputs.image)))
        return FeaturesExtraction2DOutputs(points, scores, sizes, angles)

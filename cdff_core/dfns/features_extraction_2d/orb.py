# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Orb: FAST corners on a pyramid with the orientation of their patch."""

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
from cdff_core.imaging.keypoints import ORB_LEVELS, ORB_PATCH_PX, ORB_SCALE, arrays_of


class OrbConfig(DfnConfig):
    """Parameters of Orb."""

    features: Annotated[int, Field(ge=10, le=50_000)] = 4000
    threshold_dn: Annotated[int, Field(ge=1, le=200)] = 7


class Orb(FeaturesExtraction2DInterface):
    """Oriented FAST [1]_: corners of eight levels 1.2 apart, the best by Harris' measure, turned by their centroid.

    References
    ----------
    .. [1] E. Rublee et al., ORB: an efficient alternative to SIFT or SURF, ICCV 2011, doi:10.1109/ICCV.2011.6126544
    """

    Config = OrbConfig
    config: OrbConfig

    def process(self, inputs: FeaturesExtraction2DInputs) -> FeaturesExtraction2DOutputs:
        """Detect; raises InputError on anything but a grey uint8 image."""
        c = self.config
        detector = cv2.ORB.create(
            c.features, ORB_SCALE, ORB_LEVELS, patchSize=int(ORB_PATCH_PX), fastThreshold=c.threshold_dn
        )
        points, scores, sizes, angles = arrays_of(detector.detect(checked_image(inputs.image)))
        return FeaturesExtraction2DOutputs(points, scores, sizes, angles)

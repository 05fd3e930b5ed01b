# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Orb: 256 comparisons of grey values, turned with the patch."""

from __future__ import annotations

import cv2

from cdff_core.dfns.features_description_2d._interface import (
    FeaturesDescription2DInputs,
    FeaturesDescription2DInterface,
    FeaturesDescription2DOutputs,
)
from cdff_core.dfns.features_description_2d._points import PointsConfig, checked_points, outputs_of
from cdff_core.imaging.keypoints import ORB_LEVELS, ORB_PATCH_PX, ORB_SCALE, orb_keypoints


class OrbConfig(PointsConfig):
    """Parameters of Orb."""


class Orb(FeaturesDescription2DInterface):
    """Rotated BRIEF [1]_: 32 bytes, of Hamming distance.

    References
    ----------
    .. [1] E. Rublee et al., ORB: an efficient alternative to SIFT or SURF, ICCV 2011, doi:10.1109/ICCV.2011.6126544
    """

    Config = OrbConfig
    config: OrbConfig

    def process(self, inputs: FeaturesDescription2DInputs) -> FeaturesDescription2DOutputs:
        """Describe every point; raises InputError where shapes do not fit."""
        image, points, sizes, angles = checked_points(inputs, ORB_PATCH_PX, self.config.upright)
        if not len(points):
            return outputs_of((), None, 0, 32)
        descriptor = cv2.ORB.create(len(points), ORB_SCALE, ORB_LEVELS, patchSize=int(ORB_PATCH_PX))
        described, rows = descriptor.compute(image, orb_keypoints(points, sizes, angles))
        return outputs_of(described, rows, len(points), 32)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sift: histograms of gradient directions in 4 x 4 cells."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_core.dfns.features_description_2d._interface import (
    FeaturesDescription2DInputs,
    FeaturesDescription2DInterface,
    FeaturesDescription2DOutputs,
)
from cdff_core.dfns.features_description_2d._points import SiftPointsConfig, checked_points, outputs_of
from cdff_core.imaging.keypoints import sift_keypoints


class SiftConfig(SiftPointsConfig):
    """Parameters of Sift."""


class Sift(FeaturesDescription2DInterface):
    """128 bytes, norm 512, of Euclidean distance [1]_.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    Config = SiftConfig
    config: SiftConfig

    def process(self, inputs: FeaturesDescription2DInputs) -> FeaturesDescription2DOutputs:
        """Describe every point; raises InputError where shapes do not fit."""
        c = self.config
        image, points, sizes, angles = checked_points(inputs, c.corner_size_px, c.upright)
        if not len(points):
            return outputs_of((), None, 0, 128)
        described, rows = cv2.SIFT.create().compute(image, sift_keypoints(points, sizes, angles))
        return outputs_of(described, np.asarray(rows).astype(np.uint8), len(points), 128)

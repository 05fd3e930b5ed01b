# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""RootSift: SIFT compared by Hellinger's distance."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.features_description_2d._interface import FeaturesDescription2DInputs, FeaturesDescription2DOutputs
from cdff_core.dfns.features_description_2d.sift import Sift, SiftConfig


class RootSiftConfig(SiftConfig):
    """Parameters of RootSift; the same as of Sift."""


class RootSift(Sift):
    """The square root of a SIFT descriptor of unit sum, times 512 and cut at 255: few bins no longer decide [1]_.

    References
    ----------
    .. [1] R. Arandjelovic, A. Zisserman, Three things everyone should know to improve object retrieval, CVPR 2012,
       doi:10.1109/CVPR.2012.6248018
    """

    Config = RootSiftConfig
    config: RootSiftConfig

    def process(self, inputs: FeaturesDescription2DInputs) -> FeaturesDescription2DOutputs:
        """Describe every point; raises InputError where shapes do not fit."""
        found = super().process(inputs)
        d = found.descriptors.astype(np.float32)
        root = 512.0 * np.sqrt(d / np.maximum(d.sum(axis=1, keepdims=True), 1.0))
        descriptors = np.minimum(np.rint(root), 255.0).astype(np.uint8)
        return FeaturesDescription2DOutputs(descriptors=descriptors, valid=found.valid)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""RootSift: SIFT descriptors compared by the Hellinger distance."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.features_description_2d.interface import Inputs, Outputs
from cdff_core.dfns.features_description_2d.sift import Sift


class RootSift(Sift):
    """Square root of a SIFT descriptor normalised to unit sum [1]_, times 512 and limited to 255.

    Large bins have less weight in the Euclidean distance than with SIFT.

    References
    ----------
    .. [1] R. Arandjelovic, A. Zisserman, Three things everyone should know to improve object retrieval, CVPR
       2012, doi:10.1109/CVPR.2012.6248018
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the descriptors."""
        sift = super().process(inputs)
        histograms = sift.descriptors.astype(np.float32)
        root = 512.0 * np.sqrt(histograms / np.maximum(histograms.sum(axis=1, keepdims=True), 1.0))
        descriptors = np.minimum(np.rint(root), 255.0).astype(np.uint8)
        return Outputs(descriptors=descriptors, valid=sift.valid)

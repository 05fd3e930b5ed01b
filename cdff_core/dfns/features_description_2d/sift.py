# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""SIFT descriptor: histograms of gradient directions in 4 x 4 cells."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_core.dfns.features_description_2d._points import PointsConfig, arrays_of, outputs_of
from cdff_core.dfns.features_description_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.keypoints import compile_kernel, sift_keypoints

#: Diameter of points without a size, such as corners.
_CORNER_SIZE_PX = 6.0


class Sift(Interface[PointsConfig]):
    """SIFT descriptor [1]_ of 128 bytes and norm 512, with Euclidean distance.

    References
    ----------
    .. [1] D. Lowe, Distinctive Image Features from Scale-Invariant Keypoints, IJCV 60(2), 2004,
       doi:10.1023/B:VISI.0000029664.99615.94
    """

    def setup(self) -> None:
        """Compile the kernel."""
        compile_kernel()

    def process(self, inputs: Inputs) -> Outputs:
        """Return the descriptors."""
        image, points, sizes, angles = arrays_of(inputs, _CORNER_SIZE_PX, self.config.upright)
        if not len(points):
            return outputs_of((), None, 0, 128)
        described_keypoints, rows = cv2.SIFT.create().compute(image, sift_keypoints(points, sizes, angles))
        return outputs_of(described_keypoints, np.asarray(rows).astype(np.uint8), len(points), 128)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ORB descriptor: 256 comparisons of grey values in a patch rotated to the orientation of the keypoint."""

from __future__ import annotations

import cv2

from cdff_core.dfns.features_description_2d._points import PointsConfig, arrays_of, outputs_of
from cdff_core.dfns.features_description_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.keypoints import ORB_LEVELS, ORB_PATCH_PX, ORB_SCALE, compile_kernel, orb_keypoints


class Orb(Interface[PointsConfig]):
    """Rotated BRIEF [1]_: 32 bytes with Hamming distance.

    References
    ----------
    .. [1] E. Rublee et al., ORB: an efficient alternative to SIFT or SURF, ICCV 2011,
      doi:10.1109/ICCV.2011.6126544
    """

    def setup(self) -> None:
        """Compile the kernel."""
        compile_kernel()

    def process(self, inputs: Inputs) -> Outputs:
        """Return the descriptors."""
        image, points, sizes, angles = arrays_of(inputs, ORB_PATCH_PX, self.config.upright)
        if not len(points):
            return outputs_of((), None, 0, 32)
        descriptor = cv2.ORB.create(len(points), ORB_SCALE, ORB_LEVELS, patchSize=int(ORB_PATCH_PX))
        described_keypoints, rows = descriptor.compute(image, orb_keypoints(points, sizes, angles))
        return outputs_of(described_keypoints, rows, len(points), 32)

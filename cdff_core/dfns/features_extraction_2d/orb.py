# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ORB detector: FAST corners of an image pyramid with the orientation of their patch."""

from __future__ import annotations

import cv2
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.grey import byte_mask, checked_image
from cdff_core.imaging.keypoints import ORB_LEVELS, ORB_PATCH_PX, ORB_SCALE, arrays_of


class OrbConfig(DfnConfig):
    """Parameters of Orb."""

    features: int = Field(4000, ge=10, le=50_000, description="Desired number of points over the whole image")
    threshold_dn: int = Field(
        7, ge=1, le=200, description="Minimum grey level difference to the circle around a corner"
    )


class Orb(Interface[OrbConfig]):
    """Oriented FAST [1]_: corners of a pyramid of eight levels with a scale factor of 1.2.

    The best corners by Harris response are kept; their orientation is that of the intensity centroid.

    References
    ----------
    .. [1] E. Rublee et al., ORB: an efficient alternative to SIFT or SURF, ICCV 2011,
      doi:10.1109/ICCV.2011.6126544
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the features; raises InputError on an image that is too small."""
        cfg = self.config
        detector = cv2.ORB.create(
            cfg.features, ORB_SCALE, ORB_LEVELS, patchSize=int(ORB_PATCH_PX), fastThreshold=cfg.threshold_dn
        )
        keypoints = detector.detect(checked_image(inputs.image), byte_mask(inputs.mask))
        points, scores, sizes, angles = arrays_of(keypoints)
        return Outputs(features=points, scores=scores, sizes=sizes, angles=angles)

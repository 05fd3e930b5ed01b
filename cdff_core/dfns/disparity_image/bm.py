# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Block matching: fast, for textured terrain.

References
----------
.. [1] Konolige, K. (1998). Small vision systems: hardware and implementation. Robotics Research.
   doi:10.1007/978-1-4471-1580-9_19
"""

from __future__ import annotations

import cv2
from pydantic import Field

from cdff_core.dfns.disparity_image._checked import CheckedMatcher, MatcherConfig


class BmConfig(MatcherConfig):
    """Parameters of Bm."""

    block_px: int = Field(9, ge=5, le=255, description="Edge of the matched block, an odd number")
    texture: int = Field(
        10, ge=0, le=100_000, description="Minimum sum of the horizontal gradients of a block"
    )


class Bm(CheckedMatcher[BmConfig]):
    """Block matching by the sum of absolute differences of horizontal gradients [1]_.

    Sub-pixel disparities follow from a parabola through the costs.
    """

    def _create_matcher(self) -> cv2.StereoMatcher:
        """Return the block matcher of OpenCV with the configured parameters."""
        cfg = self.config
        matcher = cv2.StereoBM.create(cfg.num_disparities, cfg.block_px)
        matcher.setMinDisparity(cfg.min_disparity_px)
        matcher.setUniquenessRatio(cfg.uniqueness_percent)
        matcher.setTextureThreshold(cfg.texture)
        matcher.setDisp12MaxDiff(-1)
        matcher.setSpeckleWindowSize(0)
        return matcher

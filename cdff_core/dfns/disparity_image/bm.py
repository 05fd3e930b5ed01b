# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Block matching: fast, for terrain with texture.

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

    block_px: int = Field(9, ge=5, le=255, description="Edge of the matched block; odd")
    texture: int = Field(
        10, ge=0, le=100_000, description="Minimum sum of the horizontal gradients of a block"
    )


class Bm(CheckedMatcher[BmConfig]):
    """Sum of absolute differences of horizontal gradients over a block ([1]_); sub-pixel by a parabola."""

    def _matcher_of_opencv(self) -> cv2.StereoMatcher:
        c = self.config
        matcher = cv2.StereoBM.create(c.num_disparities, c.block_px)
        matcher.setMinDisparity(c.min_disparity_px)
        matcher.setUniquenessRatio(c.uniqueness_percent)
        matcher.setTextureThreshold(c.texture)
        matcher.setDisp12MaxDiff(-1)
        matcher.setSpeckleWindowSize(0)
        return matcher

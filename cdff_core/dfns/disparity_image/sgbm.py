# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Semi-global matching [1]_ with a left-right check on both images.

References
----------
.. [1] Hirschmüller, H. (2008). Stereo processing by semiglobal matching and mutual information. IEEE TPAMI
   30(2). doi:10.1109/TPAMI.2007.1166
"""

from __future__ import annotations

from typing import Literal

import cv2
from pydantic import Field

from cdff_core.dfns.disparity_image._checked import CheckedMatcher, MatcherConfig

_MODES = {3: cv2.STEREO_SGBM_MODE_SGBM_3WAY, 5: cv2.STEREO_SGBM_MODE_SGBM, 8: cv2.STEREO_SGBM_MODE_HH}


class SgbmConfig(MatcherConfig):
    """Parameters of Sgbm."""

    block_px: int = Field(3, ge=1, le=15, description="Edge of the matched block, an odd number")
    paths: Literal[3, 5, 8] = Field(5, description="Number of directions in which costs are aggregated")


class Sgbm(CheckedMatcher[SgbmConfig]):
    """Semi-global matching with block costs aggregated along several directions.

    Sub-pixel disparities follow from a parabola through the costs.
    """

    def _create_matcher(self) -> cv2.StereoMatcher:
        """Return the semi-global matcher of OpenCV with the configured parameters."""
        cfg = self.config
        return cv2.StereoSGBM.create(
            minDisparity=cfg.min_disparity_px,
            numDisparities=cfg.num_disparities,
            blockSize=cfg.block_px,
            P1=8 * cfg.block_px**2,
            P2=32 * cfg.block_px**2,
            disp12MaxDiff=-1,
            preFilterCap=31,
            uniquenessRatio=cfg.uniqueness_percent,
            speckleWindowSize=0,
            speckleRange=0,
            mode=_MODES[cfg.paths],
        )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Corners of a stereo pair with sub-pixel disparities, and the rectification errors estimated from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cdff_common.arrays import FloatArray
from cdff_common.interfaces.dfn import Dfn
from cdff_core.dfns.features_extraction_2d.interface import FeaturesExtraction2DInputs
from cdff_core.dfns.rectification_refinement.interface import (
    RectificationRefinementInputs,
    RectificationRefinementOutputs,
)
from cdff_core.dfns.stereo_matching_2d.interface import StereoMatching2DInputs
from cdff_core.stereo_odometry.stereo_view import StereoView


@dataclass(frozen=True, slots=True, eq=False)
class StereoPoints:
    """Corners of the left image that were matched in the right image and do not lie on the robot."""

    detected: int  # corners before matching
    features: FloatArray  # (n, 2), columns and rows in the left image, pixels
    disparities: FloatArray  # (n,), pixels
    slopes: FloatArray  # (n, 2), derivatives of the disparity by column and row
    row_offsets: FloatArray  # (n,), row in the right minus row in the left image, pixels


class StereoPointMatcher:
    """Matches corners of the left image by the DFNs extraction and stereo_matching, and estimates the errors
    of the rectification from their row offsets by the DFN refinement.
    """

    def __init__(self, dfn: Callable[[str], Dfn[Any, Any, Any]]) -> None:
        self._extraction, self._stereo_matching = dfn("extraction"), dfn("stereo_matching")
        self._refinement = dfn("refinement")

    def match(self, view: StereoView) -> StereoPoints:
        """Return the points of a pair."""
        detected = self._extraction.process(
            FeaturesExtraction2DInputs(image=view.left, mask=view.left_mask)
        ).features
        matches = self._stereo_matching.process(
            StereoMatching2DInputs(left=view.left, right=view.right, features=detected)
        )
        valid = matches.valid & view.is_on_scene(detected, matches.disparities)
        return StereoPoints(
            detected=len(detected),
            features=detected[valid],
            disparities=matches.disparities[valid],
            slopes=matches.slopes[valid],
            row_offsets=matches.row_offsets[valid],
        )

    def refine(self, points: StereoPoints, view: StereoView) -> RectificationRefinementOutputs:
        """Update the estimate of the errors of the rectification, and return it at the points."""
        field: RectificationRefinementOutputs = self._refinement.process(
            RectificationRefinementInputs(
                features=points.features,
                disparities=points.disparities,
                camera_matrix=view.camera_matrix,
                row_offsets=points.row_offsets,
            )
        )
        return field

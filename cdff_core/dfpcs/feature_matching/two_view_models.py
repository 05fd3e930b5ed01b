# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Verification of pairs by epipolar lines, or by a plane if it explains all of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.fundamental_matrix_computation.interface import FundamentalMatrixComputationOutputs
from cdff_core.dfns.homography_computation.interface import HomographyComputationOutputs
from cdff_core.dfpcs.feature_matching.features import FloatArray, PointPairs
from cdff_core.imaging.two_view import log10_false_alarms

#: Distance of an outlier from the plane in standard deviations, beyond the tails of correct pairs.
_OUTLIER_SIGMAS = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedPairs:
    """Pairs with their inliers and residuals."""

    pairs: PointPairs
    agrees: NDArray[np.bool_]  # (n,)
    residuals: FloatArray  # (n,), distances from the model, pixels
    sigma_px: float  # Noise of the model
    log_false_alarms: float  # Significance of the model
    planar: bool  # True if the model is a plane
    planar_ratio: float  # Ratio of the pairs on epipolar lines that one plane explains
    fundamental_matrix: FloatArray  # (3, 3)

    @classmethod
    def from_model(
        cls,
        pairs: PointPairs,
        model: FundamentalMatrixComputationOutputs | HomographyComputationOutputs,
        fundamental_matrix: FloatArray,
        planar_ratio: float,
    ) -> VerifiedPairs:
        """Return the verification by the distances from epipolar lines or from the projections of a plane."""
        return cls(
            pairs=pairs,
            agrees=model.inliers,
            residuals=model.residuals,
            sigma_px=model.sigma_px,
            log_false_alarms=model.log_false_alarms,
            planar=isinstance(model, HomographyComputationOutputs),
            planar_ratio=planar_ratio,
            fundamental_matrix=fundamental_matrix,
        )

    @property
    def inliers(self) -> PointPairs:
        """Pairs that agree with the model."""
        return self.pairs[self.agrees]

    @property
    def count(self) -> int:
        """Number of inliers."""
        return int(self.agrees.sum())


def is_planar(
    pairs: PointPairs, lines: FundamentalMatrixComputationOutputs, plane: HomographyComputationOutputs
) -> bool:
    """True if chance explains the pairs that are on epipolar lines but not on the plane.

    A wrong pair deviates from the plane in any direction, and is on its epipolar line with the probability
    that a vector of that length ends in the band. Two pairs off the plane determine the epipolar geometry
    that the plane leaves undetermined, so only further ones count (a contrario, as in two_view).
    """
    off = plane.residuals > _OUTLIER_SIGMAS * plane.sigma_px
    if not off.any():
        return True
    on_lines = int((lines.inliers & off).sum())
    reach = max(3.0 * lines.sigma_px, 0.25)
    chance = np.arcsin(np.minimum(reach / plane.residuals[off], 1.0)) / (0.5 * np.pi)
    return log10_false_alarms(int(off.sum()), on_lines, float(chance.mean()), 2) > -3.0

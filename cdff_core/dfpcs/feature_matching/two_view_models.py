# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Verification of pairs by their epipolar lines, or by a homography if all points are on one plane."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.fundamental_matrix_computation.interface import FundamentalMatrixComputationOutputs
from cdff_core.dfns.homography_computation.interface import HomographyComputationOutputs
from cdff_core.dfpcs.feature_matching.features import FloatArray, PointPairs
from cdff_core.imaging.two_view import homography_residuals, log10_false_alarms

#: Distance of an outlier from the plane in standard deviations, beyond the tails of correct pairs.
_OUTLIER_SIGMAS = 8.0
#: Distance of an inlier from the plane in standard deviations, and smallest standard deviation used, pixels.
_INLIER_SIGMAS, _MIN_SIGMA_PX = 3.0, 0.25


@dataclass(frozen=True, slots=True, eq=False)
class VerifiedPairs:
    """Pairs with their inliers and residuals for one model: a fundamental matrix or a homography."""

    pairs: PointPairs
    agrees: NDArray[np.bool_]  # (n,), inliers of the model
    residuals: FloatArray  # (n,), distances from the model, pixels
    sigma_px: float  # standard deviation of the residuals of inliers
    log_false_alarms: float  # decimal logarithm of the expected number of such models among random pairs
    planar: bool  # true if the model is a homography
    planar_ratio: float  # ratio of the pairs on epipolar lines that one plane explains
    fundamental_matrix: FloatArray  # (3, 3)
    homography: FloatArray | None  # (3, 3); None if no plane was found

    @classmethod
    def from_lines(
        cls,
        pairs: PointPairs,
        lines: FundamentalMatrixComputationOutputs,
        homography: FloatArray | None = None,
    ) -> VerifiedPairs:
        """Return the pairs with the inliers and residuals of the fundamental matrix.

        ``homography`` is that of the plane with the most points; without it the planar ratio is 0.
        """
        ratio = 0.0
        if homography is not None:
            errors = homography_residuals(homography, pairs.left, pairs.right)
            ratio = planar_ratio(lines, np.linalg.norm(errors, axis=1) / np.sqrt(2.0))
        return cls._from_model(pairs, lines, lines, homography, ratio)

    @classmethod
    def from_plane(
        cls,
        pairs: PointPairs,
        lines: FundamentalMatrixComputationOutputs,
        plane: HomographyComputationOutputs,
    ) -> VerifiedPairs:
        """Return the pairs with the inliers and residuals of the homography."""
        return cls._from_model(pairs, plane, lines, plane.homography, 1.0)

    @classmethod
    def _from_model(
        cls,
        pairs: PointPairs,
        model: FundamentalMatrixComputationOutputs | HomographyComputationOutputs,
        lines: FundamentalMatrixComputationOutputs,
        homography: FloatArray | None,
        ratio: float,
    ) -> VerifiedPairs:
        """Return the pairs with the inliers and residuals of a fundamental matrix or homography."""
        return cls(
            pairs=pairs,
            agrees=model.inliers,
            residuals=model.residuals,
            sigma_px=model.sigma_px,
            log_false_alarms=model.log_false_alarms,
            planar=model is not lines,
            planar_ratio=ratio,
            fundamental_matrix=lines.fundamental_matrix,
            homography=homography,
        )

    @property
    def inliers(self) -> PointPairs:
        """Pairs that agree with the model."""
        return self.pairs[self.agrees]

    @property
    def count(self) -> int:
        """Number of inliers."""
        return int(self.agrees.sum())


def planar_ratio(lines: FundamentalMatrixComputationOutputs, plane_residuals: FloatArray) -> float:
    """Return the fraction of the pairs on epipolar lines that the plane explains with the same noise.

    The noise is that of the distances from epipolar lines. With a small baseline the residuals of the plane
    are larger than the noise, because they contain the parallax of the scene.
    """
    sigma_px = max(lines.sigma_px, _MIN_SIGMA_PX)
    on_plane = plane_residuals < _INLIER_SIGMAS * sigma_px
    return float((on_plane & lines.inliers).sum() / lines.inliers.sum())


def is_planar(
    pairs: PointPairs, lines: FundamentalMatrixComputationOutputs, plane: HomographyComputationOutputs
) -> bool:
    """Return whether chance explains the pairs that are on epipolar lines but not on the plane.

    The residual of a wrong pair from the plane has a random direction: the pair is on its epipolar line with
    the probability that a vector of that length ends in the band around the line. Two pairs off the plane
    determine the epipolar geometry that the plane leaves undetermined, so only further ones count (a
    contrario, as in two_view).
    """
    off_plane = plane.residuals > _OUTLIER_SIGMAS * max(lines.sigma_px, _MIN_SIGMA_PX)
    if not off_plane.any():
        return True
    on_lines = int((lines.inliers & off_plane).sum())
    band_px = max(3.0 * lines.sigma_px, 0.25)
    chance = np.arcsin(np.minimum(band_px / plane.residuals[off_plane], 1.0)) / (0.5 * np.pi)
    return log10_false_alarms(int(off_plane.sum()), on_lines, float(chance.mean()), 2) > -3.0

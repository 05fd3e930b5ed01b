# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Pairs judged by epipolar lines, or by a plane where that explains them all."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cdff_core.dfns.fundamental_matrix_computation._interface import FundamentalMatrixComputationOutputs
from cdff_core.dfns.homography_computation._interface import HomographyComputationOutputs
from cdff_core.dfpcs.feature_matching._features import FloatArray, Pairs
from cdff_core.imaging.two_view import log10_false_alarms

#: Distance from the plane, in its own noise, that counts as off it: tails of right pairs end before.
_OFF_SIGMAS = 8.0


@dataclass(frozen=True, slots=True, eq=False)
class Verified:
    """Pairs, which of them agree, and how well.

    Attributes
    ----------
    pairs : Pairs
    agree : ndarray of bool, shape (n,)
    residuals : ndarray, shape (n,)
        Pixels, from the model that judged.
    sigma_px, log_false_alarms : float
        Of that model.
    planar : bool
        Whether a plane judged.
    planar_share : float
        Of the pairs on epipolar lines, those that one plane explains.
    fundamental_matrix : ndarray, shape (3, 3)
    """

    pairs: Pairs
    agree: NDArray[np.bool_]
    residuals: FloatArray
    sigma_px: float
    log_false_alarms: float
    planar: bool
    planar_share: float
    fundamental_matrix: FloatArray

    @classmethod
    def by_lines(cls, pairs: Pairs, lines: FundamentalMatrixComputationOutputs, planar_share: float) -> Verified:
        """Judged by the distance from epipolar lines."""
        return cls(
            pairs, lines.inliers, lines.residuals, float(lines.sigma_px), float(lines.log_false_alarms), False,
            planar_share, lines.fundamental_matrix,
        )  # fmt: skip

    @classmethod
    def by_plane(
        cls, pairs: Pairs, lines: FundamentalMatrixComputationOutputs, plane: HomographyComputationOutputs
    ) -> Verified:
        """Judged by the distance from where the plane's homography puts them."""
        return cls(
            pairs, plane.inliers, plane.residuals, float(plane.sigma_px), float(plane.log_false_alarms), True, 1.0,
            lines.fundamental_matrix,
        )  # fmt: skip

    @property
    def inliers(self) -> Pairs:
        """Those that agree."""
        return self.pairs[self.agree]

    @property
    def count(self) -> int:
        """How many agree."""
        return int(self.agree.sum())


def one_plane_explains(
    pairs: Pairs, lines: FundamentalMatrixComputationOutputs, plane: HomographyComputationOutputs
) -> bool:
    """Whether chance brings the pairs that are on epipolar lines but off the plane.

    A wrong pair is off the plane in any direction, and on its epipolar line with the probability that a vector of
    that length ends in the band. Two pairs off the plane fix the epipolar geometry that the plane leaves free, so
    further ones count (a contrario, as in two_view). A right pair off the plane is the rule in a scene with depth.
    """
    off = plane.residuals > _OFF_SIGMAS * float(plane.sigma_px)
    if not off.any():
        return True
    extra = int((lines.inliers & off).sum())
    reach = max(3.0 * float(lines.sigma_px), 0.25)
    chance = np.arcsin(np.minimum(reach / plane.residuals[off], 1.0)) / (0.5 * np.pi)
    return log10_false_alarms(int(off.sum()), extra, float(chance.mean()), 2) > -3.0

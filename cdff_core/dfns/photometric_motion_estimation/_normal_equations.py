# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Robust normal equations of a photometric alignment, with the disparities of the reference eliminated."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import BoolArray, FloatArray

#: Mahalanobis distance at which the Cauchy weight is 0.5.
_ROBUST_SCALE = 2.0
#: Smallest standard deviation of a normalised grey level.
_MIN_SIGMA = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Warped:
    """Pixels of the reference warped into both current images; second axis: left, right."""

    residuals: FloatArray  # (n, 2), normalised grey levels, with the estimated errors of the disparities
    disparity_errors: FloatArray  # (n,), estimated errors of the disparities, pixels
    by_parameters: FloatArray  # (n, 2, 6 + k), by the pose and by the parameters of the calibration
    by_disparity: FloatArray  # (n, 2), per pixel
    gradients: FloatArray  # (n, 2, 2), by column and row
    positions: FloatArray  # (n, 2, 2), columns and rows of the level, pixels
    visible: BoolArray  # (n, 2)

    @property
    def reduced(self) -> FloatArray:
        """Residuals (n, 2) extrapolated to the measured disparities."""
        return self.residuals - self.by_disparity * self.disparity_errors[:, None]

    def sigma(self) -> float:
        """Return the standard deviation of the residuals in view, from their median magnitude.

        Errors of the disparities contribute to it: those of neighbouring pixels are not independent.
        """
        return max(1.4826 * float(np.median(np.abs(self.reduced[self.visible]))), _MIN_SIGMA)


@dataclass(frozen=True, slots=True, eq=False)
class NormalEquations:
    """Linearised robust cost at a motion."""

    normal: FloatArray  # (6 + k, 6 + k), of the pixels
    scores: FloatArray  # (n, 6 + k), gradient of each pixel
    weighted: FloatArray  # (n, 6 + k, 2), maps changes of the residuals to the gradient
    weights: FloatArray  # (n,), robust weights, 0 for pixels out of view
    reduced: FloatArray  # (n, 2), residuals extrapolated to the measured disparities
    disparity_gain: FloatArray  # (n, 2), maps these residuals to the errors of the disparities
    cost: float  # mean over the pixels in view

    @classmethod
    def of_pixels(cls, warped: Warped, sigma: float, sigma_disparity_px: float) -> NormalEquations:
        """Return the equations for the standard deviations of grey levels and of disparities.

        The two residuals of a pixel share the error of its disparity, which is estimated with the motion: the
        derivatives are computed at the estimated disparities, because those at the measured ones are
        correlated with their noise, which would bias the motion. The residuals are extrapolated to the
        measured disparities, where their covariance is ``sigma^2 I + sigma_d^2 j j^T`` with the derivatives
        j by the disparity; its inverse follows from the Sherman-Morrison formula.
        """
        j, error = warped.by_disparity * sigma_disparity_px, warped.disparity_errors / sigma_disparity_px
        r = warped.reduced
        gain = 1.0 / (sigma**2 + np.einsum("ni,ni->n", j, j))
        W = (np.eye(2) - gain[:, None, None] * j[:, :, None] * j[:, None, :]) / sigma**2
        squared = np.einsum("ni,ni->n", warped.residuals, warped.residuals) / sigma**2 + error**2
        in_view = warped.visible.any(axis=1)
        weights = np.where(in_view, 1.0 / (1.0 + squared / _ROBUST_SCALE**2), 0.0)
        weighted = np.swapaxes(warped.by_parameters, 1, 2) @ (W * weights[:, None, None])
        return cls(
            normal=np.tensordot(weighted, warped.by_parameters, axes=([0, 2], [0, 1])),
            scores=np.einsum("nij,nj->ni", weighted, r),
            weighted=weighted,
            weights=weights,
            reduced=r,
            disparity_gain=sigma_disparity_px * gain[:, None] * j,
            cost=float(np.log1p(squared[in_view] / _ROBUST_SCALE**2).mean()) if in_view.any() else np.inf,
        )

    def scatter(self, pixels: FloatArray, block_px: int) -> FloatArray:
        """Return the covariance (6 + k, 6 + k) of the gradient from its sums over blocks of the reference.

        Residuals of neighbouring pixels are correlated by the texture, by errors of the disparity and by
        moving shadows; those of different blocks are assumed to be independent (cluster-robust estimate).
        """
        column, row = (pixels // block_px).astype(np.int64).T
        _, block = np.unique(row * 10_000 + column, return_inverse=True)
        sums = np.zeros((block.max() + 1, self.scores.shape[1]))
        np.add.at(sums, block, self.scores)
        sums -= sums.mean(axis=0)
        return np.asarray(sums.T @ sums * len(sums) / max(len(sums) - sums.shape[1], 1))

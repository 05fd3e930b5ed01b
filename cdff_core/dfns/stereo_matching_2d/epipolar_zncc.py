# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Matching of points by correlation along the epipolar line, sub-pixel alignment and a backward test."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_matching_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.patch_alignment import align_patches, align_slanted, search_rows
from cdff_core.imaging.pyramid import smoothed

#: Minimum disparity of a match; below it the error of the depth is about as large as the depth.
_MIN_DISPARITY_PX = 1.0
#: Half width of the search around a guess, and half width of a patch (without its centre pixel).
_SEARCH_PX, _HALF_WINDOW_PX = 3, 7
#: Minimum correlation of the patches of a match, and minimum ratio of 1 - correlation of the second best
#: position to that of the best.
_MIN_CORRELATION, _MIN_DISTINCTNESS = 0.85, 2.0
#: Largest change of the disparity per pixel; at 1 the right camera sees the surface edge-on.
_MAX_SLOPE = 0.8
#: Largest distance from the epipolar line.
_MAX_ROW_OFFSET_PX = 1.0


class EpipolarZnccConfig(DfnConfig):
    """Parameters of EpipolarZncc."""

    max_disparity_px: int = Field(160, ge=4, le=2000, description="Largest disparity searched")


class EpipolarZncc(Interface[EpipolarZnccConfig]):
    """Match points by normalised cross-correlation at integer disparities [1]_, then align the patches by
    Gauss-Newton in both directions [2]_.

    The alignment estimates the gradient of the disparity across the patch, unless given, together with the
    position: the ground ahead of a car or rover is seen at such a grazing angle that its patches are sheared
    by pixels.

    The alignment also estimates a row offset: residual errors of the rectification (up to half a pixel on
    real rovers and cars) would otherwise cause a disparity error on every slanted edge.

    References
    ----------
    .. [1] H. Hirschmuller, D. Scharstein, Evaluation of Stereo Matching Costs, PAMI 31(9), 2009,
       doi:10.1109/TPAMI.2008.221
    .. [2] S. Baker, I. Matthews, Lucas-Kanade 20 Years On, IJCV 56(3), 2004,
      doi:10.1023/B:VISI.0000011205.11775.fd
    """

    def setup(self) -> None:
        """Compile the kernels."""
        image, point, one = np.zeros((48, 48), np.float32), np.full((1, 2), 24.0), np.ones(1, np.int64)
        search_rows(image, image, point, one, one, 3)
        align_patches(image, image, point, point, np.eye(3)[None], 3, 1, 0.1)
        align_slanted(image, image, point, point, 3, 1, 0.1, 0.5)

    def process(self, inputs: Inputs) -> Outputs:
        """Return a match for every point; raises InputError if the images are too small."""
        c = self.config
        points = np.array(inputs.features, np.float64)
        n = len(points)
        left, right = smoothed(inputs.left), smoothed(inputs.right)
        lowest, highest = np.zeros(n, np.int64), np.full(n, c.max_disparity_px, np.int64)
        if inputs.guess is not None:
            centre = np.rint(np.clip(inputs.guess, 0.0, c.max_disparity_px)).astype(np.int64)
            lowest, highest = np.maximum(centre - _SEARCH_PX, 0), centre + _SEARCH_PX
        coarse, best, second = search_rows(left, right, points, lowest, highest, min(_HALF_WINDOW_PX, 5))
        unique = (
            (1.0 - second) >= _MIN_DISTINCTNESS * (1.0 - best) if inputs.guess is None else np.ones(n, bool)
        )
        start = points - np.column_stack([np.nan_to_num(coarse), np.zeros(n)])
        matches, slopes, scores = self._align(left, right, points, start, inputs.slopes)
        back, back_scores = align_patches(
            right, left, matches, points, np.linalg.inv(_shear_warps(slopes)), _HALF_WINDOW_PX, 20, 0.005
        )
        disparities, row_offsets = points[:, 0] - matches[:, 0], matches[:, 1] - points[:, 1]
        valid = (
            unique & np.isfinite(coarse) & (scores >= _MIN_CORRELATION) & (back_scores >= _MIN_CORRELATION)
        )
        valid &= np.abs(matches[:, 0] - start[:, 0]) <= 1.5
        valid &= (np.abs(row_offsets) <= _MAX_ROW_OFFSET_PX) & (disparities >= _MIN_DISPARITY_PX)
        valid &= np.hypot(*(back - points).T) <= 0.5
        return Outputs(disparities=disparities, row_offsets=row_offsets, slopes=slopes, valid=valid)

    @staticmethod
    def _align(
        left: Float32Array,
        right: Float32Array,
        points: FloatArray,
        start: FloatArray,
        given_slopes: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the positions of the patches in the right image, their slopes and correlations."""
        if given_slopes is not None:
            matches, scores = align_patches(
                left, right, points, start, _shear_warps(given_slopes), _HALF_WINDOW_PX, 20, 0.005
            )
            return matches, given_slopes, scores
        matches, slopes, scores = align_slanted(
            left, right, points, start, _HALF_WINDOW_PX, 20, 0.005, _MAX_SLOPE
        )
        # If the slope is not observable, the surface is assumed to be parallel to the image.
        without_slope = scores < 0.0
        slopes[without_slope] = 0.0
        matches[without_slope], scores[without_slope] = align_patches(
            left,
            right,
            points[without_slope],
            start[without_slope],
            _shear_warps(slopes[without_slope]),
            _HALF_WINDOW_PX,
            20,
            0.005,
        )
        return matches, slopes, scores


def _shear_warps(slopes: FloatArray) -> FloatArray:
    """Return the warps ``(n, 3, 3)`` from left to right patch for a gradient of the disparity."""
    warps = np.tile(np.eye(3), (len(slopes), 1, 1))
    warps[:, 0, :2] -= slopes
    return warps

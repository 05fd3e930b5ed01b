# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Correlation along the epipolar line, sub-pixel alignment and backward test."""

from __future__ import annotations

import numpy as np
from pydantic import Field

from cdff_common.arrays import Float32Array, FloatArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_matching_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.patch_alignment import align_patches, align_slanted, search_rows
from cdff_core.imaging.pyramid import smoothed

#: Smallest disparity accepted: below it the depth has an error of its own size.
_MIN_DISPARITY_PX = 1.0
#: Half widths of the search around a guess, and of a patch without its centre pixel.
_SEARCH_PX, _HALF_WINDOW_PX = 3, 7
#: Minimum correlation of the patches of a match, and minimum ratio of 1 - second best to 1 - best.
_MIN_CORRELATION, _AMBIGUITY = 0.85, 2.0
#: Largest change of the disparity per pixel: at 1 the surface is seen edge-on by the right camera.
_MAX_SLOPE = 0.8
#: Largest distance from the epipolar line.
_MAX_ROW_OFFSET_PX = 1.0


class EpipolarZnccConfig(DfnConfig):
    """Parameters of EpipolarZncc."""

    max_disparity_px: int = Field(160, ge=4, le=2000, description="Largest disparity searched")


class EpipolarZncc(Interface[EpipolarZnccConfig]):
    """Normalised cross-correlation over whole disparities [1]_, then Gauss-Newton in both directions [2]_.

    The refinement estimates the gradient of the disparity across the patch with its centre, unless given: the
    ground ahead of a car or rover is seen at such a grazing angle that its patches are sheared by pixels.

    The refinement may leave the row: residual errors of the rectification (up to half a pixel on real rovers
    and cars) would otherwise cause a disparity error on every slanted edge.

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
        """Match every point; raises InputError on images that are too small."""
        c = self.config
        points = np.array(inputs.features, np.float64)
        n = len(points)
        left, right = smoothed(inputs.left), smoothed(inputs.right)
        lowest, highest = np.zeros(n, np.int64), np.full(n, c.max_disparity_px, np.int64)
        if inputs.guess is not None:
            centre = np.rint(np.clip(inputs.guess, 0.0, c.max_disparity_px)).astype(np.int64)
            lowest, highest = np.maximum(centre - _SEARCH_PX, 0), centre + _SEARCH_PX
        whole, best, second = search_rows(left, right, points, lowest, highest, min(_HALF_WINDOW_PX, 5))
        unique = (1.0 - second) >= _AMBIGUITY * (1.0 - best) if inputs.guess is None else np.ones(n, bool)
        start = points - np.column_stack([np.nan_to_num(whole), np.zeros(n)])
        found, slopes, scores = self._align(left, right, points, start, inputs.slopes)
        back, returned = align_patches(
            right, left, found, points, np.linalg.inv(_sheared(slopes)), _HALF_WINDOW_PX, 20, 0.005
        )
        disparities, row_offsets = points[:, 0] - found[:, 0], found[:, 1] - points[:, 1]
        valid = unique & np.isfinite(whole) & (scores >= _MIN_CORRELATION) & (returned >= _MIN_CORRELATION)
        valid &= np.abs(found[:, 0] - start[:, 0]) <= 1.5
        valid &= (np.abs(row_offsets) <= _MAX_ROW_OFFSET_PX) & (disparities >= _MIN_DISPARITY_PX)
        valid &= np.hypot(*(back - points).T) <= 0.5
        return Outputs(disparities=disparities, row_offsets=row_offsets, slopes=slopes, valid=valid)

    @staticmethod
    def _align(
        left: Float32Array,
        right: Float32Array,
        points: FloatArray,
        start: FloatArray,
        known: FloatArray | None,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the positions of the patches in the right image, their slopes and correlations."""
        if known is not None:
            found, scores = align_patches(
                left, right, points, start, _sheared(known), _HALF_WINDOW_PX, 20, 0.005
            )
            return found, known, scores
        found, slopes, scores = align_slanted(
            left, right, points, start, _HALF_WINDOW_PX, 20, 0.005, _MAX_SLOPE
        )
        lost = scores < 0.0  # slope not observable: treated as facing the camera
        slopes[lost] = 0.0
        found[lost], scores[lost] = align_patches(
            left, right, points[lost], start[lost], _sheared(slopes[lost]), _HALF_WINDOW_PX, 20, 0.005
        )
        return found, slopes, scores


def _sheared(slopes: FloatArray) -> FloatArray:
    """Return warps ``(n, 3, 3)`` from left to right patch, sheared by the disparity's gradient."""
    warps = np.tile(np.eye(3), (len(slopes), 1, 1))
    warps[:, 0, :2] -= slopes
    return warps

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""EpipolarZncc: correlation along the epipolar line, then sub-pixel alignment, then the way back."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.stereo_matching_2d._interface import (
    StereoMatching2DInputs,
    StereoMatching2DInterface,
    StereoMatching2DOutputs,
)
from cdff_core.imaging.patch_alignment import align_patches, align_slanted, search_rows
from cdff_core.imaging.pyramid import smoothed

FloatImage = NDArray[np.float32]
FloatArray = NDArray[np.float64]


class EpipolarZnccConfig(DfnConfig):
    """Parameters of EpipolarZncc."""

    max_disparity_px: Annotated[int, Field(ge=4, le=2000)] = 160
    min_disparity_px: Annotated[float, Field(gt=0, le=100)] = 1.0
    search_px: Annotated[int, Field(ge=1, le=100)] = 3
    half_window_px: Annotated[int, Field(ge=2, le=30)] = 7
    min_correlation: Annotated[float, Field(ge=0, lt=1)] = 0.85
    ambiguity: Annotated[float, Field(ge=1, le=100)] = 2.0
    max_slope: Annotated[float, Field(gt=0, lt=1)] = 0.8
    max_row_offset_px: Annotated[float, Field(gt=0, le=10)] = 1.0


class EpipolarZncc(StereoMatching2DInterface):
    """Normalised cross-correlation over whole disparities [1]_, then Gauss-Newton in both directions [2]_.

    The refinement finds how the disparity slopes across the patch along with its centre, where that is not given: the
    ground ahead of a car or rover is seen so flatly that its patches are sheared by pixels.

    The refinement is free to leave the row: what the rectification left over (up to half a pixel on real rovers and
    cars) would otherwise turn into a disparity error on every slanted edge.

    References
    ----------
    .. [1] H. Hirschmuller, D. Scharstein, Evaluation of Stereo Matching Costs, PAMI 31(9), 2009,
       doi:10.1109/TPAMI.2008.221
    .. [2] S. Baker, I. Matthews, Lucas-Kanade 20 Years On, IJCV 56(3), 2004, doi:10.1023/B:VISI.0000011205.11775.fd
    """

    Config = EpipolarZnccConfig
    config: EpipolarZnccConfig

    def setup(self) -> None:
        """Compile the kernels."""
        image, point, one = np.zeros((48, 48), np.float32), np.full((1, 2), 24.0), np.ones(1, np.int64)
        search_rows(image, image, point, one, one, 3)
        align_patches(image, image, point, point, np.eye(3)[None], 3, 1, 0.1)
        align_slanted(image, image, point, point, 3, 1, 0.1, 0.5)

    def process(self, inputs: StereoMatching2DInputs) -> StereoMatching2DOutputs:
        """Match every point; raises InputError where shapes do not fit."""
        c = self.config
        points = np.array(inputs.features, np.float64)
        n = len(points)
        if inputs.left.shape != inputs.right.shape or points.ndim != 2 or points.shape[1] != 2:
            shapes = f"left {inputs.left.shape}, right {inputs.right.shape}, features {points.shape}"
            raise InputError(f"{shapes}: expected images of equal size and (n, 2)")
        if inputs.guess is not None and inputs.guess.shape != (n,):
            raise InputError(f"guess {inputs.guess.shape}: expected ({n},)")
        if inputs.slopes is not None and inputs.slopes.shape != (n, 2):
            raise InputError(f"slopes {inputs.slopes.shape}: expected ({n}, 2)")
        left, right = smoothed(inputs.left), smoothed(inputs.right)
        lowest, highest = np.zeros(n, np.int64), np.full(n, c.max_disparity_px, np.int64)
        if inputs.guess is not None:
            centre = np.rint(np.clip(inputs.guess, 0.0, c.max_disparity_px)).astype(np.int64)
            lowest, highest = np.maximum(centre - c.search_px, 0), centre + c.search_px
        whole, best, second = search_rows(left, right, points, lowest, highest, min(c.half_window_px, 5))
        unique = (1.0 - second) >= c.ambiguity * (1.0 - best) if inputs.guess is None else np.ones(n, bool)
        start = points - np.column_stack([np.nan_to_num(whole), np.zeros(n)])
        found, slopes, scores = self._align(left, right, points, start, inputs.slopes)
        back, returned = align_patches(
            right, left, found, points, np.linalg.inv(_sheared(slopes)), c.half_window_px, 20, 0.005
        )
        disparities, row_offsets = points[:, 0] - found[:, 0], found[:, 1] - points[:, 1]
        valid = unique & np.isfinite(whole) & (scores >= c.min_correlation) & (returned >= c.min_correlation)
        valid &= np.abs(found[:, 0] - start[:, 0]) <= 1.5
        valid &= (np.abs(row_offsets) <= c.max_row_offset_px) & (disparities >= c.min_disparity_px)
        valid &= np.hypot(*(back - points).T) <= 0.5
        return StereoMatching2DOutputs(disparities=disparities, row_offsets=row_offsets, slopes=slopes, valid=valid)

    def _align(
        self, left: FloatImage, right: FloatImage, points: FloatArray, start: FloatArray, known: FloatArray | None
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where the patches lie in the right image, their slopes, and how well they correlate."""
        c = self.config
        if known is not None:
            found, scores = align_patches(left, right, points, start, _sheared(known), c.half_window_px, 20, 0.005)
            return found, known, scores
        found, slopes, scores = align_slanted(left, right, points, start, c.half_window_px, 20, 0.005, c.max_slope)
        lost = scores < 0.0  # no slope could be told: as if it faced the camera
        slopes[lost] = 0.0
        found[lost], scores[lost] = align_patches(
            left, right, points[lost], start[lost], _sheared(slopes[lost]), c.half_window_px, 20, 0.005
        )
        return found, slopes, scores


def _sheared(slopes: FloatArray) -> FloatArray:
    """Warps ``(n, 3, 3)`` from the left to the right patch: a column moves on by one less the disparity's change."""
    warps = np.tile(np.eye(3), (len(slopes), 1, 1))
    warps[:, 0, :2] -= slopes
    return warps

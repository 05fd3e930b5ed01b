# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Test of a dense disparity image: do the two images show the same points, and on the same rows?

Semi-global matching finds disparities in any two images. At corners of the left image, the patch around the
matched point is aligned in two dimensions with the right image. Where the images do not belong together
(exchanged cameras, different times, a camera without image), few patches agree. An error of the rectification
is observed as an offset of the rows, which biases the disparity of every edge that is not vertical: by the
offset itself on an edge at 45 degrees.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from cdff_common.arrays import ByteArray, Float32Array, FloatArray
from cdff_common.types import Frame, FramePair
from cdff_core.imaging.grey_pair import grey_pair
from cdff_core.imaging.patch_alignment import align_patches, align_slanted
from cdff_core.imaging.pyramid import smoothed

#: Number of corners, and their least distance in pixels.
_CORNERS, _CORNER_DISTANCE_PX = 400, 8.0
#: Half width of a patch, largest change of the disparity per pixel, and largest distance from the disparity.
_HALF_WINDOW_PX, _MAX_SLOPE, _MAX_DISTANCE_PX = 7, 0.8, 1.5
#: Least correlation of a patch that agrees.
_MIN_CORRELATION = 0.85
#: Least number of corners, and least size of an image, for the test.
_MIN_CORNERS, _MIN_SIZE_PX = 20, 32
#: Fraction of the corners that agree; in two different scenes it is a few per cent by chance.
MIN_AGREEMENT, GOOD_AGREEMENT = 0.15, 0.3
#: Largest row error: twice the standard deviation of a disparity, so that the biased disparities of edges at
#: 45 degrees are within three standard deviations.
MAX_ROW_ERROR_PX = 0.6


@dataclass(frozen=True, slots=True)
class StereoConsistency:
    """Agreement of two images with their disparities.

    Attributes
    ----------
    corners : int
        Corners of the left image.
    agreement : float
        Fraction of the corners that have a disparity and whose patches agree; NaN with too few corners.
    row_error_px : float
        Robust RMS of the row offsets of these patches (median and spread), pixels; NaN without them.
    """

    corners: int
    agreement: float
    row_error_px: float

    def failures(self) -> list[str]:
        """Return the reasons if the two images do not show the same scene at the same time.

        Images of a moving camera at different times agree in places, but neither well nor on the same rows.
        """
        deficiencies = self.deficiencies()
        is_mismatch = self.agreement < MIN_AGREEMENT or (
            self.agreement < GOOD_AGREEMENT and self.row_error_px > MAX_ROW_ERROR_PX
        )
        return deficiencies if is_mismatch else []

    def deficiencies(self) -> list[str]:
        """Return the reasons for DEGRADED: few corners to test, little agreement, a row error."""
        reasons = []
        if self.corners < _MIN_CORNERS:
            reasons.append(f"untested_pair:{self.corners}<{_MIN_CORNERS}")
        if self.agreement < GOOD_AGREEMENT:
            reasons.append(f"stereo_mismatch:{self.agreement:.2f}<{GOOD_AGREEMENT:g}")
        if self.row_error_px > MAX_ROW_ERROR_PX:
            reasons.append(f"row_error:{self.row_error_px:.2f}>{MAX_ROW_ERROR_PX:g}")
        return reasons

    def metrics(self) -> dict[str, float]:
        """Return the metrics that are known."""
        values = {"agreement": self.agreement, "row_error_px": self.row_error_px}
        return {name: value for name, value in values.items() if np.isfinite(value)}


def pair_consistency(pair: FramePair, disparity: Frame) -> StereoConsistency:
    """Return the agreement of a rectified stereo pair with its disparity image."""
    return stereo_consistency(*grey_pair(pair.left, pair.right), disparity.image)


def compile_kernels() -> None:
    """Compile the kernels, so that the first pair takes no longer than the others."""
    image, point = np.zeros((48, 48), np.float32), np.full((1, 2), 24.0)
    _align_patches(image, image, point, point)


def stereo_consistency(left: ByteArray, right: ByteArray, disparity: Float32Array) -> StereoConsistency:
    """Return the agreement of two rectified grey images (rows, cols) with the disparities (rows, cols)."""
    if min(left.shape) < _MIN_SIZE_PX:
        return StereoConsistency(0, float("nan"), float("nan"))
    corners = _corners(left)
    columns, rows = corners.astype(int).T
    disparities = disparity[rows, columns].astype(np.float64)
    has_disparity = np.isfinite(disparities)
    points, disparities = corners[has_disparity], disparities[has_disparity]
    if len(corners) < _MIN_CORNERS:
        return StereoConsistency(len(corners), float("nan"), float("nan"))
    start = points - np.column_stack([disparities, np.zeros(len(points))])
    matches, scores = _align_patches(smoothed(left), smoothed(right), points, start)
    is_near_start = np.abs(matches[:, 0] - start[:, 0]) <= _MAX_DISTANCE_PX
    agrees = (scores >= _MIN_CORRELATION) & is_near_start
    row_error_px = _robust_rms(matches[agrees, 1] - points[agrees, 1])
    return StereoConsistency(len(corners), float(agrees.sum() / len(corners)), row_error_px)


def _robust_rms(offsets: FloatArray) -> float:
    """Return the root of the squares of median and spread; NaN without offsets."""
    if not len(offsets):
        return float("nan")
    median = float(np.median(offsets))
    # The median absolute deviation of a normal variable is 0.6745 standard deviations.
    return float(np.hypot(median, np.median(np.abs(offsets - median)) / 0.6745))


def _corners(left: ByteArray) -> FloatArray:
    """Return corners (n, 2) of an image: columns and rows."""
    corners = cv2.goodFeaturesToTrack(np.ascontiguousarray(left), _CORNERS, 0.01, _CORNER_DISTANCE_PX)
    return np.zeros((0, 2)) if corners is None else corners[:, 0].astype(np.float64)


def _align_patches(
    left: Float32Array, right: Float32Array, points: FloatArray, start: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return positions (n, 2) in the right image and correlations (n,); patches follow a slanted surface."""
    matches, _, scores = align_slanted(left, right, points, start, _HALF_WINDOW_PX, 20, 0.005, _MAX_SLOPE)
    flat = scores < 0.0
    warps = np.tile(np.eye(3), (int(flat.sum()), 1, 1))
    matches[flat], scores[flat] = align_patches(
        left, right, points[flat], start[flat], warps, _HALF_WINDOW_PX, 20, 0.005
    )
    return matches, scores

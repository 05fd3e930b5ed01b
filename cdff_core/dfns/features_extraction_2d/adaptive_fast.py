# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""FAST corners with a suppression radius that follows from the desired number of features."""

from __future__ import annotations

import cv2
import numpy as np
from pydantic import Field

from cdff_common.arrays import BoolArray, ByteArray, FloatArray, IntArray
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_2d._kernels import suppress
from cdff_core.dfns.features_extraction_2d.interface import Inputs, Interface, Outputs
from cdff_core.imaging.grey import byte_mask, checked_image

#: Width of the image border that is excluded.
_BORDER_PX = 8
#: Half width and half height of the window of the sub-pixel refinement.
_REFINE_PX = (3, 3)


class AdaptiveFastConfig(DfnConfig):
    """Parameters of AdaptiveFast."""

    features: int = Field(2000, ge=10, le=50_000, description="Desired number of points over the whole image")
    threshold_dn: int = Field(
        5, ge=1, le=200, description="Minimum grey level difference to the circle around a corner"
    )


class AdaptiveFast(Interface[AdaptiveFastConfig]):
    """FAST [1]_ with a low threshold, then non-maximum suppression in squares [2]_.

    The size of the squares is chosen to obtain the desired number of corners. Regions of high and low
    contrast contribute equally, since a corner only has to be the strongest of its neighbourhood.

    References
    ----------
    .. [1] E. Rosten, R. Porter, T. Drummond, Faster and Better, PAMI 32(1), 2010, doi:10.1109/TPAMI.2008.275
    .. [2] O. Bailo et al., Efficient adaptive non-maximal suppression algorithms for homogeneous spatial
       keypoint distribution, Pattern Recognition Letters 106, 2018, doi:10.1016/j.patrec.2018.02.020
    """

    def setup(self) -> None:
        """Compile the kernel."""
        suppress(np.zeros(1, np.int64), np.zeros(1, np.int64), (8, 8), 2)

    def process(self, inputs: Inputs) -> Outputs:
        """Return the features; raises InputError on an image that is too small."""
        cfg, image = self.config, checked_image(inputs.image)
        corners = cv2.FastFeatureDetector.create(cfg.threshold_dn, True).detect(image, byte_mask(inputs.mask))
        points = np.array(cv2.KeyPoint.convert(corners), np.float64).reshape(-1, 2)
        scores = np.array([corner.response for corner in corners], np.float64)
        rows, columns = image.shape
        lower_px, upper_px = _BORDER_PX - 0.5, np.array([columns, rows]) - _BORDER_PX - 0.5
        is_inside = ((points > lower_px) & (points < upper_px)).all(axis=1)
        order = np.flatnonzero(is_inside)
        order = order[np.lexsort((points[order, 0], points[order, 1], -scores[order]))]
        selected_rows = order[self._suppress(points[order].astype(np.int64), (rows, columns))]
        return Outputs(features=self._refine(image, points[selected_rows]), scores=scores[selected_rows])

    @staticmethod
    def _refine(image: ByteArray, points: FloatArray) -> FloatArray:
        """Return the sub-pixel positions of corners (Foerstner), or the pixels if over 1.5 px away."""
        if not len(points):
            return points
        criteria = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.02)
        corners = cv2.cornerSubPix(
            image, np.array(points[:, None], np.float32, order="C"), _REFINE_PX, (-1, -1), criteria
        )[:, 0]
        is_near = np.hypot(*(corners - points).T) <= 1.5
        return np.where(is_near[:, None], corners.astype(np.float64), points)

    def _suppress(self, points: IntArray, shape: tuple[int, int]) -> BoolArray:
        """Return which points remain with the smallest square that leaves at most the desired number.

        The half width of the square is found by bisection.
        """
        desired = self.config.features
        columns, rows = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
        lower, upper = 0, int(2.0 * np.sqrt(shape[0] * shape[1] / desired)) + 2
        is_kept = np.ones(len(points), bool)
        if len(points) <= desired:
            return is_kept
        while upper - lower > 1:
            radius = (lower + upper) // 2
            is_candidate_kept = suppress(columns, rows, shape, radius)
            if is_candidate_kept.sum() > desired:
                lower = radius
            else:
                upper, is_kept = radius, is_candidate_kept
        if is_kept.sum() > desired:
            is_kept = suppress(columns, rows, shape, upper)
        return is_kept

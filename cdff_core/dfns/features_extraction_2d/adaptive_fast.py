# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""AdaptiveFast: FAST corners, the strongest of a neighbourhood whose size follows from how many are wanted."""

from __future__ import annotations

from typing import Annotated

import cv2
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_extraction_2d._grid import checked_image
from cdff_core.dfns.features_extraction_2d._interface import (
    FeaturesExtraction2DInputs,
    FeaturesExtraction2DInterface,
    FeaturesExtraction2DOutputs,
)
from cdff_core.dfns.features_extraction_2d._kernels import spread


class AdaptiveFastConfig(DfnConfig):
    """Parameters of AdaptiveFast."""

    features: Annotated[int, Field(ge=10, le=50_000)] = 2000
    border_px: Annotated[int, Field(ge=3, le=200)] = 8
    threshold_dn: Annotated[int, Field(ge=1, le=200)] = 5
    refine_px: Annotated[int, Field(ge=0, le=15)] = 3


class AdaptiveFast(FeaturesExtraction2DInterface):
    """A low threshold everywhere, then suppression by squares as large as leaves the number wanted ([1]_, [2]_).

    Bright and dark regions get their share: what counts is to be the strongest around, not to be strong.

    References
    ----------
    .. [1] E. Rosten, R. Porter, T. Drummond, Faster and Better, PAMI 32(1), 2010, doi:10.1109/TPAMI.2008.275
    .. [2] O. Bailo et al., Efficient adaptive non-maximal suppression algorithms for homogeneous spatial keypoint
       distribution, Pattern Recognition Letters 106, 2018, doi:10.1016/j.patrec.2018.02.020
    """

    Config = AdaptiveFastConfig
    config: AdaptiveFastConfig

    def setup(self) -> None:
        """Compile the kernel."""
        spread(np.zeros(1, np.int64), np.zeros(1, np.int64), (8, 8), 2)

    def process(self, inputs: FeaturesExtraction2DInputs) -> FeaturesExtraction2DOutputs:
        """Detect; raises InputError on anything but a grey uint8 image."""
        c, image = self.config, checked_image(inputs.image)
        corners = cv2.FastFeatureDetector.create(c.threshold_dn, True).detect(image)
        points = np.array(cv2.KeyPoint.convert(corners), np.float64).reshape(-1, 2)
        scores = np.array([corner.response for corner in corners], np.float64)
        rows, columns = image.shape
        low, high = c.border_px - 0.5, np.array([columns, rows]) - c.border_px - 0.5
        inside = ((points > low) & (points < high)).all(axis=1)
        order = np.flatnonzero(inside)
        order = order[np.lexsort((points[order, 0], points[order, 1], -scores[order]))]
        kept = order[self._suppressed(points[order].astype(np.int64), (rows, columns))]
        return FeaturesExtraction2DOutputs(features=self._refined(image, points[kept]), scores=scores[kept])

    def _refined(self, image: NDArray[np.uint8], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the gradients around meet (Foerstner); the whole pixel where that is not near."""
        half = self.config.refine_px
        if not half or not len(points):
            return points
        until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 10, 0.02)
        corners = cv2.cornerSubPix(
            image, np.array(points[:, None], np.float32, order="C"), (half, half), (-1, -1), until
        )[:, 0]
        near = np.hypot(*(corners - points).T) <= 1.5
        return np.where(near[:, None], corners.astype(np.float64), points)

    def _suppressed(self, points: NDArray[np.int64], shape: tuple[int, int]) -> NDArray[np.bool_]:
        """The smallest square that leaves no more than are wanted, by bisection."""
        wanted = self.config.features
        columns, rows = np.ascontiguousarray(points[:, 0]), np.ascontiguousarray(points[:, 1])
        least, most = 0, int(2.0 * np.sqrt(shape[0] * shape[1] / wanted)) + 2
        kept = np.ones(len(points), bool)
        if len(points) <= wanted:
            return kept
        while most - least > 1:
            radius = (least + most) // 2
            tried = spread(columns, rows, shape, radius)
            if tried.sum() > wanted:
                least = radius
            else:
                most, kept = radius, tried
        if kept.sum() > wanted:
            kept = spread(columns, rows, shape, most)
        return kept

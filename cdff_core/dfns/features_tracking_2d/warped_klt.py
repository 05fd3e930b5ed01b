# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""WarpedKlt: Lucas-Kanade tracking of patches that are warped as a motion prediction says."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cdff_common.errors import InputError
from cdff_common.interfaces.dfn import DfnConfig
from cdff_core.dfns.features_tracking_2d._interface import (
    FeaturesTracking2DInputs,
    FeaturesTracking2DInterface,
    FeaturesTracking2DOutputs,
)
from cdff_core.imaging.patch_alignment import align_patches
from cdff_core.imaging.pyramid import pyramid

FloatArray = NDArray[np.float64]


class WarpedKltConfig(DfnConfig):
    """Parameters of WarpedKlt."""

    half_window_px: Annotated[int, Field(ge=2, le=30)] = 7
    levels: Annotated[int, Field(ge=1, le=8)] = 3
    iterations: Annotated[int, Field(ge=1, le=100)] = 12
    tolerance_px: Annotated[float, Field(gt=0, le=1)] = 0.01
    min_correlation: Annotated[float, Field(ge=0, lt=1)] = 0.85
    max_return_error_px: Annotated[float, Field(gt=0, le=10)] = 0.5


class WarpedKlt(FeaturesTracking2DInterface):
    """Inverse-compositional Lucas-Kanade [1]_ over a pyramid [2]_, forward and backward [3]_.

    The patch is resampled with the expected warp, so that a point approached by a quarter of its distance, or on ground
    seen flatly, is still followed without bias; gain and offset of the patch are removed, so that exposure may change.

    References
    ----------
    .. [1] S. Baker, I. Matthews, Lucas-Kanade 20 Years On, IJCV 56(3), 2004, doi:10.1023/B:VISI.0000011205.11775.fd
    .. [2] J.-Y. Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker, Intel, 2000
    .. [3] Z. Kalal et al., Forward-Backward Error, ICPR 2010, doi:10.1109/ICPR.2010.675
    """

    Config = WarpedKltConfig
    config: WarpedKltConfig

    def setup(self) -> None:
        """Compile the kernel."""
        image, point = np.zeros((48, 48), np.float32), np.full((1, 2), 24.0)
        align_patches(image, image, point, point, np.eye(3)[None], 3, 1, 0.1)

    def process(self, inputs: FeaturesTracking2DInputs) -> FeaturesTracking2DOutputs:
        """Track every point; raises InputError where shapes do not fit."""
        c = self.config
        points = np.array(inputs.features, np.float64)
        guess = points if inputs.guess is None else np.array(inputs.guess, np.float64)
        warps = np.tile(np.eye(3), (len(points), 1, 1)) if inputs.warps is None else np.array(inputs.warps, np.float64)
        n = len(points)
        if points.shape != (n, 2) or guess.shape != (n, 2) or warps.shape != (n, 3, 3):
            shapes = f"features {points.shape}, guess {guess.shape}, warps {warps.shape}"
            raise InputError(f"{shapes}: expected (n, 2), (n, 2), (n, 3, 3)")
        reference, image = pyramid(inputs.reference, c.levels), pyramid(inputs.image, c.levels)
        matches, scores = self._descend(reference, image, points, guess, warps)
        back, returned = align_patches(
            image[0], reference[0], matches, points, np.linalg.inv(warps),
            c.half_window_px, c.iterations, c.tolerance_px,
        )  # fmt: skip
        valid = (scores >= c.min_correlation) & (returned >= c.min_correlation)
        valid &= np.hypot(*(back - points).T) <= c.max_return_error_px
        return FeaturesTracking2DOutputs(matches=matches, valid=valid, scores=scores)

    def _descend(
        self,
        reference: list[NDArray[np.float32]],
        image: list[NDArray[np.float32]],
        points: FloatArray,
        guess: FloatArray,
        warps: FloatArray,
    ) -> tuple[FloatArray, FloatArray]:
        """Coarse to fine; a level on which a point is not found leaves its guess as it was."""
        c = self.config
        found, scores = guess, np.full(len(points), -1.0)
        for level in range(len(image) - 1, -1, -1):
            size = 2.0**level
            coarse = warps.copy()
            coarse[:, 2, :2] *= size  # per pixel of this level
            finer, scores = align_patches(
                reference[level],
                image[level],
                points / size,
                found / size,
                coarse,
                c.half_window_px,
                c.iterations,
                c.tolerance_px * (1.0 if level == 0 else 5.0),
            )
            found = np.where((scores > 0.5)[:, None] | (level == 0), finer * size, found)
        return found, scores

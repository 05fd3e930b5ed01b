# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""PyramidalKlt: OpenCV's Lucas-Kanade tracker, forward and backward."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError
from cdff_core.dfns.features_tracking_2d._interface import (
    FeaturesTracking2DInputs,
    FeaturesTracking2DInterface,
    FeaturesTracking2DOutputs,
)
from cdff_core.dfns.features_tracking_2d.warped_klt import WarpedKltConfig
from cdff_core.imaging.patch_alignment import align_patches
from cdff_core.imaging.pyramid import smoothed

FloatArray = NDArray[np.float64]


class PyramidalKltConfig(WarpedKltConfig):
    """Parameters of PyramidalKlt; the same as of WarpedKlt."""


class PyramidalKlt(FeaturesTracking2DInterface):
    """Bouguet's pyramidal Lucas-Kanade [1]_ as OpenCV has it; the warps only enter the correlation.

    References
    ----------
    .. [1] J.-Y. Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker, Intel, 2000
    """

    Config = PyramidalKltConfig
    config: PyramidalKltConfig

    def process(self, inputs: FeaturesTracking2DInputs) -> FeaturesTracking2DOutputs:
        """Track every point; raises InputError where shapes do not fit."""
        c = self.config
        points = np.array(inputs.features, np.float64)
        guess = points if inputs.guess is None else np.array(inputs.guess, np.float64)
        if points.ndim != 2 or points.shape[1] != 2 or guess.shape != points.shape:
            raise InputError(f"features {points.shape}, guess {guess.shape}: expected both (n, 2)")
        warps = np.tile(np.eye(3), (len(points), 1, 1)) if inputs.warps is None else np.array(inputs.warps, np.float64)
        matches, forward = self._flow(inputs.reference, inputs.image, points, guess)
        back, backward = self._flow(inputs.image, inputs.reference, matches, points)
        _, scores = align_patches(
            smoothed(inputs.reference), smoothed(inputs.image), points, matches, warps, c.half_window_px, 1, np.inf
        )
        valid = forward & backward & (scores >= c.min_correlation)
        valid &= np.hypot(*(back - points).T) <= c.max_return_error_px
        return FeaturesTracking2DOutputs(matches=matches, valid=valid, scores=scores)

    def _flow(
        self, first: NDArray[np.uint8], second: NDArray[np.uint8], points: FloatArray, guess: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        if len(points) == 0:
            return points, np.zeros(0, bool)
        c = self.config
        side = 2 * c.half_window_px + 1
        found, status, _ = cv2.calcOpticalFlowPyrLK(
            np.ascontiguousarray(first), np.ascontiguousarray(second),
            np.ascontiguousarray(points[:, None], np.float32), np.ascontiguousarray(guess[:, None], np.float32),
            winSize=(side, side), maxLevel=c.levels - 1, flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, c.iterations, c.tolerance_px),
        )  # fmt: skip
        return found[:, 0].astype(np.float64), status[:, 0].astype(bool)

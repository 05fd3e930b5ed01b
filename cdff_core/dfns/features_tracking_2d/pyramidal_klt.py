# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""OpenCV's pyramidal Lucas-Kanade tracker, forward and backward."""

from __future__ import annotations

import cv2
import numpy as np

from cdff_common.arrays import BoolArray, ByteArray, FloatArray
from cdff_core.dfns.features_tracking_2d.interface import Inputs, Interface, Outputs
from cdff_core.dfns.features_tracking_2d.warped_klt import (
    HALF_WINDOW_PX,
    MAX_RETURN_ERROR_PX,
    MIN_CORRELATION,
    TOLERANCE_PX,
    WarpedKltConfig,
    arrays_of,
)
from cdff_core.imaging.patch_alignment import align_patches
from cdff_core.imaging.pyramid import smoothed


class PyramidalKlt(Interface[WarpedKltConfig]):
    """OpenCV's pyramidal Lucas-Kanade tracker [1]_; warps are used only for the final correlation.

    References
    ----------
    .. [1] J.-Y. Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker, Intel, 2000
    """

    def process(self, inputs: Inputs) -> Outputs:
        """Return the tracked points; raises InputError on images that are too small."""
        points, guess, warps = arrays_of(inputs)
        matches, found_forward = self._flow(inputs.reference, inputs.image, points, guess)
        tracked_back, found_backward = self._flow(inputs.image, inputs.reference, matches, points)
        _, scores = align_patches(
            smoothed(inputs.reference),
            smoothed(inputs.image),
            points,
            matches,
            warps,
            HALF_WINDOW_PX,
            1,
            np.inf,
        )
        valid = found_forward & found_backward & (scores >= MIN_CORRELATION)
        valid &= np.hypot(*(tracked_back - points).T) <= MAX_RETURN_ERROR_PX
        return Outputs(matches=matches, valid=valid, scores=scores)

    def _flow(
        self, first: ByteArray, second: ByteArray, points: FloatArray, guess: FloatArray
    ) -> tuple[FloatArray, BoolArray]:
        """Return positions ``(n, 2)`` in the second image and whether each point was tracked."""
        if len(points) == 0:
            return points, np.zeros(0, bool)
        cfg = self.config
        window_px = 2 * HALF_WINDOW_PX + 1
        positions, status, _ = cv2.calcOpticalFlowPyrLK(
            np.ascontiguousarray(first),
            np.ascontiguousarray(second),
            np.ascontiguousarray(points[:, None], np.float32),
            np.ascontiguousarray(guess[:, None], np.float32),
            winSize=(window_px, window_px),
            maxLevel=cfg.levels - 1,
            flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
            criteria=(cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, cfg.iterations, TOLERANCE_PX),
        )
        return positions[:, 0].astype(np.float64), status[:, 0].astype(bool)

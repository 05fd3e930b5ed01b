# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate of the part of the disparity field that the row offsets of a stereo pair do not determine."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry.se3 import FloatArray

#: Standard deviation of the change from keyframe to keyframe, pixels.
_SIGMA_WALK_PX = 0.002


class DisparityCalibration:
    """Gaussian estimate of the undetermined part of the disparity field (see RectificationRefinement).

    The motion estimator refines it. The result becomes the prior only with the next keyframe, since all
    motions from one keyframe share the noise of that keyframe.
    """

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Clear the estimate."""
        self.mean_px: FloatArray = np.zeros(2)
        self.covariance_px2: FloatArray | None = None
        self._latest: tuple[FloatArray, FloatArray] | None = None

    def store(self, mean_px: FloatArray, covariance_px2: FloatArray) -> None:
        """Store a result of the motion estimator until the next keyframe."""
        self._latest = (mean_px, covariance_px2)

    def update(self, open_covariance: FloatArray) -> None:
        """Use the stored result as the prior of a keyframe; the first prior is ``open_covariance`` (2, 2)."""
        if self.covariance_px2 is None:
            self.covariance_px2 = open_covariance
        if self._latest is not None:
            mean, covariance = self._latest
            self.mean_px, self.covariance_px2 = mean, covariance + _SIGMA_WALK_PX**2 * np.eye(2)
            self._latest = None

    def metrics(self) -> dict[str, float]:
        """Return the estimate by name."""
        offset_px, decentring_px = (float(p) for p in self.mean_px)
        return {"disparity_offset_px": offset_px, "decentring_px": decentring_px}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate of the disparity field that stereo rows leave undetermined."""

from __future__ import annotations

import numpy as np

from cdff_common.geometry.se3 import FloatArray

#: Growth of the standard deviation from keyframe to keyframe, pixels.
_SIGMA_WALK_PX = 0.002


class DisparityCalibration:
    """Gaussian over the undetermined part of the disparity field (see RectificationRefinement).

    The motion estimator narrows it. Its result becomes the prior only with the next keyframe, since estimates
    against one keyframe share the noise of that keyframe.
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
        """Use the stored result as prior of a new keyframe; start with what the rows leave undetermined."""
        if self.covariance_px2 is None:
            self.covariance_px2 = open_covariance
        if self._latest is not None:
            mean, covariance = self._latest
            self.mean_px, self.covariance_px2 = mean, covariance + _SIGMA_WALK_PX**2 * np.eye(2)
            self._latest = None

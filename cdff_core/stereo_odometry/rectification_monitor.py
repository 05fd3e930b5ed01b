# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Errors of the rectification in the newest pairs, from the row offsets of matched points.

The estimate of ``EpipolarField`` has a memory of many pairs and adapts slowly to a camera that has moved. The
monitor compares the newest pairs with rectified ones (row offset, rotation about the optical axis), and with
that estimate (rotation about the vertical, which rows determine only together with the lens).
"""

from __future__ import annotations

from collections import deque

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_core.stereo_odometry.limits import rectification_reasons
from cdff_core.stereo_odometry.stereo_points import StereoPoints

#: Largest rotation of the right camera about its optical axis, and largest change of its rotation about the
#: vertical, degrees: half of a rotation that displaces poses noticeably.
MAX_ROLL_DEG, MAX_YAW_CHANGE_DEG = 0.06, 0.06
#: Number of standard deviations by which an angle must differ from 0.
_SIGNIFICANT = 4.0
#: Number of keyframes in the estimate, and least number of points.
_KEYFRAMES, _LEAST_POINTS = 3, 60
#: Standard deviation of a row offset, pixels, and information of the weak prior of each coefficient.
_SIGMA_PX, _PRIOR = 0.2, 0.04
_ITERATIONS = 8


class RectificationMonitor:
    """Row offset and rotations of the right camera in the newest keyframes."""

    def __init__(self) -> None:
        self._newest: deque[tuple[FloatArray, FloatArray]] = deque(maxlen=_KEYFRAMES)
        self.row_offset_px = 0.0
        self.roll_deg = 0.0
        self.yaw_change_deg = 0.0

    def update(self, points: StereoPoints, coefficients: FloatArray, camera_matrix: FloatArray) -> list[str]:
        """Add the points of a keyframe, and return the reasons for DEGRADED.

        Parameters
        ----------
        points : StereoPoints
        coefficients : ndarray, shape (4,)
            Estimate from all keyframes: coefficients of 1, x, y and x y in the row offsets, pixels.
        camera_matrix : ndarray, shape (3, 3)
        """
        K, focal_px = camera_matrix, float(camera_matrix[0, 0])
        x = (points.features[:, 0] - points.disparities - K[0, 2]) / K[0, 0]
        y = (points.features[:, 1] - K[1, 2]) / K[1, 1]
        self._newest.append((np.column_stack([np.ones(len(x)), x, y, x * y]), points.row_offsets))
        rows = np.concatenate([design for design, _ in self._newest])
        offsets = np.concatenate([values for _, values in self._newest])
        if len(rows) < _LEAST_POINTS:
            return []
        mean, sigma = _fitted(rows, offsets, coefficients)
        self.row_offset_px = float(mean[0])
        self.roll_deg = float(np.rad2deg(mean[1] / focal_px))
        self.yaw_change_deg = float(np.rad2deg((mean[3] - coefficients[3]) / focal_px))
        sigma_deg = np.rad2deg(sigma / focal_px)
        reasons = rectification_reasons(self.row_offset_px)
        for name, value, limit, sd in (
            ("camera_roll", self.roll_deg, MAX_ROLL_DEG, sigma_deg[1]),
            ("camera_yaw_change", self.yaw_change_deg, MAX_YAW_CHANGE_DEG, sigma_deg[3]),
        ):
            if abs(value) > max(limit, _SIGNIFICANT * float(sd)):
                reasons.append(f"{name}:{abs(value):.2f}>{limit:.2f}")
        return reasons


def _fitted(design: FloatArray, offsets: FloatArray, start: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return coefficients and standard deviations by least squares with Cauchy weights."""
    mean = start.copy()
    # Rectified pairs have no offset, roll and scale; the rotation about the vertical is the estimated one.
    prior_mean = np.array([0.0, 0.0, 0.0, start[3]])
    for _ in range(_ITERATIONS):
        residuals = offsets - design @ mean
        weights = 1.0 / (_SIGMA_PX**2 * (1.0 + (residuals / (2.0 * _SIGMA_PX)) ** 2))
        information = design.T @ (design * weights[:, None]) + _PRIOR * np.eye(4)
        mean = mean + np.linalg.solve(
            information, design.T @ (weights * residuals) + _PRIOR * (prior_mean - mean)
        )
    return mean, np.sqrt(np.diag(np.linalg.inv(information)))

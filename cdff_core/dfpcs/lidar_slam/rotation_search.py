# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for the rotation of a sweep that does not match the local map at the predicted pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3

Float = NDArray[np.float64]

#: Step of the rotations: neighbouring ones differ by one voxel at the distance of most points.
_STEP_DEG = 5.0
#: Weight of the newest sweep in the mean support.
_NEWEST_WEIGHT = 0.2
#: Support relative to the mean of previous sweeps below which a sweep does not match as expected.
_LOW_SUPPORT = 0.7
#: Least ratio of the support at a rotation to that at the prediction: on ground without relief all rotations
#: have nearly the same support, and the prediction is kept.
_SIGNIFICANT_RATIO = 1.15


class SupportMonitor:
    """Mean support of previous sweeps, and decisions by comparison with it."""

    def __init__(self) -> None:
        self._mean: float | None = None

    def update(self, support: float) -> None:
        """Add the support of a registered sweep."""
        previous = support if self._mean is None else self._mean
        self._mean = previous + _NEWEST_WEIGHT * (support - previous)

    def is_low(self, support: float) -> bool:
        """Return whether a support is unexpected; true for the first sweep, whose motion is unknown."""
        return self._mean is None or support < _LOW_SUPPORT * self._mean

    def is_better(self, support: float, support_at_prediction: float) -> bool:
        """Return whether the result of a search replaces that of the prediction."""
        expected = 0.0 if self._mean is None else _LOW_SUPPORT * self._mean
        return support > max(_SIGNIFICANT_RATIO * support_at_prediction, expected)


def rotations_about_lidar_axis(T: Float) -> Float:
    """Return a pose (4, 4) rotated about the lidar's axis by all multiples of the step, (m, 4, 4)."""
    angles_rad = np.radians(np.arange(_STEP_DEG, 360.0, _STEP_DEG))
    rotations = np.tile(np.eye(4), (len(angles_rad), 1, 1))
    rotations[:, :3, :3] = se3.exp_so3(angles_rad[:, None] * np.array([0.0, 0.0, 1.0]))
    return np.asarray(T @ rotations)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Search for the rotation of a sweep that does not match the local map at the predicted pose."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cdff_common.geometry import se3

Float = NDArray[np.float64]

#: Step of the rotations: at the distance of most points it is the edge of a voxel.
_STEP_DEG = 5.0
#: Weight of the newest sweep in the mean support.
_NEWEST_WEIGHT = 0.2
#: Ratio of the support to the mean of previous sweeps below which a sweep does not match as expected.
_LOW_SUPPORT = 0.7
#: Minimum ratio of the support at a searched rotation to that at the prediction: on ground without relief all
#: rotations have nearly the same support, and the prediction is kept.
_SIGNIFICANT_RATIO = 1.15


class SupportMonitor:
    """Mean support of previous sweeps, with which the support of the next sweep is compared.

    The support is the mean weight of the robust kernel over the points of a sweep, from 0 to 1.
    """

    def __init__(self) -> None:
        self._mean: float | None = None

    def update(self, support: float) -> None:
        """Add the support of a registered sweep."""
        previous = support if self._mean is None else self._mean
        self._mean = previous + _NEWEST_WEIGHT * (support - previous)

    def is_low(self, support: float) -> bool:
        """Return whether a support is lower than expected; True before the first sweep was registered."""
        return self._mean is None or support < _LOW_SUPPORT * self._mean

    def is_better(self, support: float, support_at_prediction: float) -> bool:
        """Return whether a searched rotation with ``support`` replaces the registration at the prediction."""
        expected = 0.0 if self._mean is None else _LOW_SUPPORT * self._mean
        return support > max(_SIGNIFICANT_RATIO * support_at_prediction, expected)


def rotations_about_lidar_axis(T_odom_lidar: Float) -> Float:
    """Return a pose (4, 4) rotated about the z axis of the lidar by all multiples of the step (m, 4, 4)."""
    angles_rad = np.radians(np.arange(_STEP_DEG, 360.0, _STEP_DEG))
    rotations = np.tile(np.eye(4), (len(angles_rad), 1, 1))
    rotations[:, :3, :3] = se3.exp_so3(angles_rad[:, None] * np.array([0.0, 0.0, 1.0]))
    return np.asarray(T_odom_lidar @ rotations)

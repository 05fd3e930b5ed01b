# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of motions predicted at constant velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

#: Standard deviations while the velocity is unknown: translation, metres, and rotation, radians.
_UNKNOWN_SIGMA = np.array([1.0] * 3 + [0.1] * 3)
#: Minimum standard deviations while the velocity is known.
_LEAST_SIGMA = np.array([0.2] * 3 + [0.05] * 3)
#: Weight of the newest prediction error in the mean of the squared errors.
_NEWEST_WEIGHT = 0.3


class MotionUncertainty:
    """Mean squared errors of recent predictions along each axis of the lidar.

    After the adaptive threshold of Vizzo et al. (2023), "KISS-ICP", doi:10.1109/LRA.2023.3236571.
    """

    def __init__(self) -> None:
        self._variance: Float | None = None  # (6,); None while the velocity is unknown

    @property
    def covariance(self) -> Float:
        """Covariance (6, 6) of the next predicted motion, in the lidar's axes."""
        variance = np.square(_UNKNOWN_SIGMA) if self._variance is None else self._variance
        return np.diag(np.maximum(variance, np.square(_LEAST_SIGMA)))

    def update(self, error: Float) -> None:
        """Add the error (6,) of a prediction: translation, metres, and rotation, radians.

        The first error is not averaged: it is the motion at the velocity that was unknown until then.
        """
        if self._variance is None:
            self._variance = np.square(_LEAST_SIGMA)
            return
        self._variance = (1.0 - _NEWEST_WEIGHT) * self._variance + _NEWEST_WEIGHT * np.square(error)


def growth(sweeps: int, *, by_odometry: bool) -> tuple[float, float]:
    """Return the growth of the covariance of one predicted motion over sweeps without a measurement.

    The first factor is for the pose after ``sweeps`` such sweeps and one more motion, the second for this
    last motion alone. The relative error of odometry is constant: the standard deviation grows with the
    number n of motions. The velocity changes at random from motion to motion: the variance grows with the sum
    of the squares from 1 to n.
    """
    n = sweeps + 1
    if by_odometry:
        return float(n * n), float(2 * n - 1)
    return n * (n + 1) * (2 * n + 1) / 6.0, float(n * n)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Uncertainty of motions predicted at constant velocity."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

#: Standard deviations while the velocity is unknown: translation, metres, and rotation, radians.
_UNKNOWN_SIGMA = np.array([1.0] * 3 + [0.1] * 3)
#: Standard deviations of a prediction error due to the noise of the poses from which the velocity is
#: computed.
_POSE_SIGMA = np.array([0.02] * 3 + [0.005] * 3)
#: Minimum standard deviations of a prediction error over one second due to accelerations.
_LEAST_SIGMA = np.array([0.6] * 3 + [0.14] * 3)
#: Shortest interval over which a prediction error measures accelerations.
_LEAST_INTERVAL_S = 0.05
#: Weight of the newest prediction error in the mean of the squared errors.
_NEWEST_WEIGHT = 0.3


class MotionUncertainty:
    """Covariance of motions at constant velocity, estimated from the errors of recent predictions.

    The velocity is a random walk: the variance of a predicted motion grows with the cube of the interval
    (white noise acceleration; Bar-Shalom, Li, Kirubarajan 2001, "Estimation with Applications to Tracking and
    Navigation", section 6.2.2). The mean of the squared errors of recent predictions is its scale, as in the
    adaptive threshold of Vizzo et al. (2023), "KISS-ICP", doi:10.1109/LRA.2023.3236571.
    """

    def __init__(self) -> None:
        self._variance: Float | None = (
            None  # (6,), variance of the motion over one second; None while the velocity is unknown
        )

    def covariance(self, interval_s: float) -> Float:
        """Return the covariance (6, 6) of the predicted motion over an interval, in the lidar's axes."""
        if self._variance is None:
            return np.diag(np.square(_UNKNOWN_SIGMA))
        variance = np.maximum(self._variance, np.square(_LEAST_SIGMA))
        return np.diag(np.square(_POSE_SIGMA) + variance * interval_s**3)

    def update(self, error: Float, interval_s: float) -> None:
        """Add the error (6,) of a prediction over an interval: translation, metres, and rotation, radians.

        The first error is not averaged: the velocity was unknown until then, so that the error is the whole
        motion.
        """
        if self._variance is None:
            self._variance = np.square(_LEAST_SIGMA)
            return
        variance = (
            np.maximum(np.square(error) - np.square(_POSE_SIGMA), 0.0)
            / max(interval_s, _LEAST_INTERVAL_S) ** 3
        )
        self._variance = (1.0 - _NEWEST_WEIGHT) * self._variance + _NEWEST_WEIGHT * variance


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

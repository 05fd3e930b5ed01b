# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Vertical of the base according to one sensor: gravity of an accelerometer, ground of a lidar."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np

from cdff_common.geometry.se3 import FloatArray
from cdff_core.consistency.limits import Limits
from cdff_core.consistency.moments import Moments

#: Number of directions after which the weight of a direction is 1/e, and the least number of an estimate.
_MEMORY, LEAST_DIRECTIONS = 60.0, 4
#: Scatter of a direction per axis that is assumed beforehand, rad², and the number of directions it
#: counts for: few directions, which are correlated, agree by chance.
_PRIOR_SCATTER, _PRIOR_DIRECTIONS = float(np.radians(10.0)) ** 2, 2.0
#: Number of successive directions whose errors are correlated, a factor on the variance: a slope lasts for
#: several of them.
_CORRELATION = 4.0
#: Number of directions that the vertical counts for when sensors are compared: more would outweigh motions.
_GREATEST_WEIGHT = 20.0
_UP = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, slots=True, eq=False)
class VerticalEstimate:
    """Mean vertical by a sensor.

    Attributes
    ----------
    samples : float
    direction : ndarray, shape (3,)
        Unit vector in base axes by the stated mount; [0, 0, 1] on level ground.
    sigma_rad : float
        Standard deviation of the angle of the mean.
    angle_rad : float
        Angle to the z axis of the base.
    excess : float
        Ratio of the angle to its limit; above 1 it is not admissible.
    """

    samples: float
    direction: FloatArray
    sigma_rad: float
    angle_rad: float
    excess: float


class Vertical:
    """Mean of directions in base axes.

    Parameters
    ----------
    limit_rad : float
        Admissible angle of the mean to the z axis.
    """

    def __init__(self, limit_rad: float) -> None:
        self._limit_rad = limit_rad
        self._n, self._sum, self._squares = 0.0, np.zeros(3), 0.0

    def add(self, direction: FloatArray) -> None:
        """Add a unit vector (3,)."""
        keep = float(np.exp(-1.0 / _MEMORY))
        self._n = keep * self._n + 1.0
        self._sum = keep * self._sum + direction
        self._squares = keep * self._squares + float(direction @ direction)

    def estimate(self, limits: Limits) -> VerticalEstimate | None:
        """Return the mean direction; None with too few directions."""
        if self._n < LEAST_DIRECTIONS:
            return None
        mean = self._sum / self._n
        length = float(np.linalg.norm(mean))
        if length < 0.5:  # the directions have no common mean
            return None
        measured_scatter = max(self._squares / self._n - length**2, 0.0) / 2.0
        weight = _PRIOR_DIRECTIONS / (_PRIOR_DIRECTIONS + self._n)
        scatter = weight * _PRIOR_SCATTER + (1.0 - weight) * measured_scatter
        sigma_rad = float(np.sqrt(scatter * _CORRELATION / self._n)) / length
        angle_rad = float(np.arccos(np.clip(mean[2] / length, -1.0, 1.0)))
        allowed_rad = self._limit_rad + NormalDist().inv_cdf(1.0 - limits.false_alarm) * sigma_rad
        return VerticalEstimate(self._n, mean / length, sigma_rad, angle_rad, angle_rad / allowed_rad)

    def moments(self) -> Moments:
        """Return the z axis and the directions as pairs of vectors, with the limit as their noise."""
        n = min(self._n, _GREATEST_WEIGHT)
        mean = self._sum / max(self._n, 1.0)
        return Moments(
            n=n,
            aa=n * np.outer(_UP, _UP),
            ab=n * np.outer(_UP, mean),
            bb=n * np.outer(mean, mean),
            axes=np.ones(3),
            floor=(0.5 * self._limit_rad) ** 2,
        )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Estimate of the pose of one sensor in the frame of another, with an assessment in words."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from cdff_common.arrays import FloatArray
from cdff_common.geometry import UncertainTransform
from cdff_core.calibration.estimate import DIRECTIONS

#: Largest standard deviation of a determined direction, metres and radians.
LIMITS = np.array([0.01] * 3 + [np.deg2rad(0.5)] * 3)


@dataclass(frozen=True, slots=True, eq=False)
class RelativePose:
    """Pose ``T_parent_child`` of a sensor.

    Attributes
    ----------
    transform : UncertainTransform
        With the covariance of all six directions.
    undetermined : tuple of str
        Directions of ``DIRECTIONS`` whose standard deviation exceeds ``LIMITS``.
    sentences : tuple of str
        Assessment, each sentence with the remedy.
    used, dropped : int
        Number of views that were used, and of views that contradict the others.
    figures : mapping of str to float
        Further estimates and residuals; names end in their unit.
    """

    transform: UncertainTransform
    undetermined: tuple[str, ...]
    sentences: tuple[str, ...]
    used: int
    dropped: int
    figures: Mapping[str, float]

    @property
    def sigma(self) -> FloatArray:
        """Standard deviations ``(6,)``, metres and radians."""
        assert self.transform.covariance is not None
        return np.sqrt(np.diag(self.transform.covariance))


def undetermined_directions(covariance: FloatArray) -> tuple[str, ...]:
    """Return the directions whose standard deviation exceeds ``LIMITS``."""
    sigma = np.sqrt(np.diag(covariance))
    return tuple(name for name, s, limit in zip(DIRECTIONS, sigma, LIMITS, strict=True) if s > limit)

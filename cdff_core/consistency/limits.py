# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Differences between sensors that are admissible, and the rate of false alarms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class Limits:
    """Admissible differences.

    Attributes
    ----------
    false_alarm : float
        Probability that a single test of sensors within these limits fails.
    mount_sigma_rad : float
        Standard deviation per axis of an admissible mount error.
    slope_rad : float
        Steepest mean slope of the ground over the memory of a test: admissible angle of gravity to the z axis
        of the base.
    ground_tilt_rad : float
        Admissible mean angle of the ground that a sensor sees to the plane of the wheels.
    offset_s : float
        Admissible offset of the clock of a stream.
    refused_fraction : float
        Admissible fraction of refused increments of an odometry.
    lost_fraction : float
        Admissible fraction of lost samples of a stream.
    rate_ratio : float
        Admissible ratio of the measured to the stated rate of a stream, or of the stated to the measured one.
    """

    false_alarm: float = 1e-6
    mount_sigma_rad: float = float(np.radians(1.0))
    slope_rad: float = float(np.radians(30.0))
    ground_tilt_rad: float = float(np.radians(6.0))
    offset_s: float = 0.2
    refused_fraction: float = 0.5
    lost_fraction: float = 0.2
    rate_ratio: float = 1.5

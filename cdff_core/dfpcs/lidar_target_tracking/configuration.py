# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of LidarTargetTracking."""

from __future__ import annotations

from pydantic import Field

from cdff_core.object_models.body_tracking import BodyTrackingConfig


class LidarTargetTrackingConfig(BodyTrackingConfig):
    """Parameters of the tracker, and of the DFN slots."""

    sigma_m: float = Field(
        0.0,
        ge=0,
        le=10,
        description="Standard deviation of a measured range, metres; 0: estimated from the scans",
    )
    min_points: int = Field(
        20, ge=10, le=10_000, description="Number of points near the body below which a scan is not used"
    )
    min_agreement: float = Field(
        0.5,
        gt=0,
        le=1,
        description="Fraction of the points near the body that must agree with the model",
    )
    detect_after: int = Field(
        3, ge=1, le=1000, description="Consecutive scans without use after which the body is detected"
    )
    search_scans: bool = Field(
        True,
        description="Search for the body in scans without a track; False: use the detections of the input",
    )
    min_score: float = Field(
        0.7, gt=0, le=1, description="Fraction of the rays that must agree with the model in a detection"
    )
    guess_sigma_m: float = Field(
        0.05, gt=0, le=100, description="Standard deviation of the position of a guess without covariance"
    )
    guess_sigma_rad: float = Field(
        0.1, gt=0, le=3, description="Standard deviation of the rotation of a guess without covariance"
    )
    attitude_age_s: float = Field(
        2.0, gt=0, le=60, description="Largest time between a scan and the nearest attitude of the sensor, s"
    )
    sensor_rate_sigma_radps: float = Field(
        0.02,
        ge=0,
        le=1,
        description="Standard deviation of the rate of the sensor, rad/s, while its attitude is missing",
    )

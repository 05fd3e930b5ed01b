# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of FarRangeTracking."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class FarRangeTrackingConfig(DfpcConfig):
    """Parameters of the compound and of its DFNs."""

    target_height_m: float | None = Field(
        None, gt=0.0, le=1e4, description="Height of the objects from their lowest to their highest point, m"
    )
    target_height_sigma: float = Field(
        0.02, ge=0.0, le=1.0, description="Relative standard deviation of the height"
    )
    target_length_m: float = Field(
        1.0,
        ge=0.0,
        le=1e3,
        description="Length of the objects: the terrain range is that of their lowest point, m",
    )
    model_unit: Literal["m", "mm", "km"] = Field("m", description="Unit of the vertices of the model")
    attitude_age_s: float = Field(
        0.05, ge=0.0, le=60.0, description="Largest difference in time between attitude or pose and image, s"
    )
    attitude_noise_rad: float = Field(
        2.0e-4, ge=0.0, le=0.1, description="Error of the attitude that differs between images, rad"
    )
    attitude_sigma_deg: float = Field(
        0.1, ge=0.0, le=30.0, description="Standard deviation of an attitude without covariance, degrees"
    )
    max_rate_rad_s: float = Field(
        0.05, gt=0.0, le=10.0, description="Largest angular velocity of an object, rad/s"
    )
    confirm_hits: int = Field(5, ge=2, le=100, description="Number of images that confirm an object")
    confirm_path_px: float = Field(
        2.0, ge=0.0, le=100.0, description="Least path relative to the scene that confirms an object, px"
    )
    lost_s: float = Field(
        60.0, gt=0.0, le=1e5, description="Time without a measurement after which an object is lost, s"
    )
    lost_rad: float = Field(
        0.06, gt=0.0, le=3.0, description="Standard deviation from which an object is lost, rad"
    )
    min_score: float = Field(
        0.6,
        gt=0.0,
        le=1.0,
        description="Least correlation of the appearance of an object in successive images",
    )
    min_size_px: float = Field(
        3.0, ge=1.0, le=100.0, description="Least width and height of a new object, px"
    )
    min_range_px: float = Field(
        5.0, ge=2.0, le=100.0, description="Least height for a range by apparent size, px"
    )
    max_disparity_px: float = Field(
        100.0, gt=1.0, le=2000.0, description="Largest disparity of an object, px"
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of FarRangeObjectTracking."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from cdff_common.interfaces.dfpc import DfpcConfig

Positive = Annotated[float, Field(gt=0.0, le=1e7)]


class FarRangeObjectTrackingConfig(DfpcConfig):
    """Parameters of the compound and of its DFN slots."""

    saturation_dn: float = Field(
        0.0,
        ge=0.0,
        le=1e9,
        description="Grey level from which a pixel is saturated, DN; 0: the largest of its type",
    )
    point_spread_px: float = Field(
        0.8, ge=0.3, le=20.0, description="Initial standard deviation of the light of a point source, px"
    )
    attitude_sigma_deg: float = Field(
        0.1, gt=0.0, le=30.0, description="Standard deviation of the given attitude about each axis, degrees"
    )
    attitude_noise_rad: float = Field(
        2.5e-5, gt=0.0, le=0.1, description="Error of the given attitude that differs between images, rad"
    )
    attitude_age_s: float = Field(
        0.05,
        ge=0.0,
        le=60.0,
        description="Largest difference in time between a given attitude and its image, s",
    )
    use_stars: bool = Field(True, description="Identify stars; false if the field of view has none")
    catalogue_sigma_rad: float = Field(
        1.5e-5,
        ge=0.0,
        le=0.01,
        description="Error of a direction by lens and catalogue beyond the noise, rad",
    )
    identify_sources: int = Field(
        60, ge=4, le=500, description="Number of the brightest sources that are compared with the catalogue"
    )
    weak_window_px: float = Field(
        12.0, ge=2.0, le=100.0, description="Largest half width of the window of a weak source, px"
    )
    observer: Literal["earth", "sun"] = Field(
        "earth",
        description="Body that the camera moves with, for the aberration of the stars: Earth (plus the"
        " velocity of the input navigation) or Sun (no aberration)",
    )
    target_sizes_m: tuple[Positive, Positive] | None = Field(
        None,
        description="Smallest and largest apparent size of the target of all views, m, without a model",
    )
    informative_range: float = Field(
        0.1,
        gt=0.0,
        le=10.0,
        description="Relative standard deviation up to which a range is informative",
    )
    model_unit: Literal["m", "mm", "km"] = Field("m", description="Unit of the vertices of the model")
    body_attitude_age_s: float = Field(
        0.5,
        ge=0.0,
        le=3600.0,
        description="Largest difference in time between the attitude of the target and an image, s",
    )

    @model_validator(mode="after")
    def _sizes_are_in_order(self) -> Self:
        if self.target_sizes_m is not None and self.target_sizes_m[0] > self.target_sizes_m[1]:
            raise ValueError(f"target_sizes_m={self.target_sizes_m}: expected the smallest size first")
        return self

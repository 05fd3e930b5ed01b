# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualTargetTracking."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_core.object_models.state_filter import NewTrackConfig


class VisualTargetTrackingConfig(NewTrackConfig):
    """Parameters of the tracker, and of the DFN slots."""

    unit: Literal["m", "mm", "cm", "km"] = Field("m", description="Unit of the vertices of the model")
    centre_of_mass_m: tuple[float, float, float] | None = Field(
        None, description="Centre of mass in the frame of the body, metres; default: the centre of the model"
    )
    centre_of_mass_sigma: float = Field(
        0.15,
        ge=0,
        le=10,
        description="Standard deviation of the centre of mass, relative to the diameter; 0 if it is known",
    )
    rounds: int = Field(
        3, ge=1, le=10, description="Measurements of the edges of an image, each from a better pose"
    )
    max_range_px: float = Field(
        24.0, ge=2, le=200, description="Largest distance of an image edge from the prediction, px"
    )
    min_points: int = Field(
        30, ge=6, le=10_000, description="Number of edge points in the image below which it is not used"
    )
    min_agreement: float = Field(
        0.35, gt=0, le=1, description="Fraction of the edge points below which an image is not used"
    )
    good_agreement: float = Field(
        0.5, gt=0, le=1, description="Fraction of the edge points below which a used image is DEGRADED"
    )
    gate_probability: float = Field(
        0.99999, gt=0.5, lt=1, description="Probability that a correct image agrees with the prediction"
    )
    guess_sigma: float = Field(
        0.02,
        gt=0,
        le=1,
        description="Standard deviation of the position of a guess without covariance, in diameters",
    )
    guess_sigma_rad: float = Field(
        0.03, gt=0, le=3, description="Standard deviation of the rotation of a guess without covariance"
    )

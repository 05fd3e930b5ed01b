# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of TargetDetection."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class TargetDetectionConfig(DfpcConfig):
    """Parameters of the detection, and of the DFN slots."""

    unit: Literal["m", "mm", "cm", "km"] = Field(
        "m", description="Unit of the vertices of the models; those of clouds are metres"
    )
    min_points: int = Field(
        20,
        ge=10,
        le=10_000,
        description="Number of points of a body below which it is refused: FAILED few_points",
    )
    sigma_m: float = Field(
        0.0,
        ge=0,
        le=10,
        description="Standard deviation of a measured range, metres; 0: estimated from the scan",
    )
    max_bodies: int = Field(
        4, ge=1, le=50, description="Largest number of bodies in a scan that are examined"
    )
    min_score: float = Field(
        0.8, gt=0, le=1, description="Fraction of the rays that agree with the model: FAILED low_score below"
    )
    ambiguity: float = Field(
        12.0,
        ge=0,
        le=1000,
        description="Difference of -2 log likelihood up to which another pose is an alternative: DEGRADED",
    )
    position_max_age_s: float = Field(
        10.0, gt=0, le=1e4, description="Age of an expected position above which it is not used"
    )
    relative_speed_mps: float = Field(
        2.0, ge=0, le=100, description="Largest speed of a body relative to its expected position"
    )

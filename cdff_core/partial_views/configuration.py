# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the search for a model in a single view."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel


class ViewSearchConfig(StrictModel):
    """Parameters of the search in a single view; the unit of lengths is the diameter of the model."""

    enabled: bool = Field(
        default=True, description="Search in a single view if the descriptors yield no pose"
    )
    step: float = Field(
        default=0.05, gt=0.01, le=0.2, description="Spacing of the points whose pairs vote, in diameters"
    )
    tolerance: float = Field(
        default=0.04,
        gt=0,
        le=0.2,
        description="Largest depth difference between model and scene that agree, in diameters",
    )
    coarse_factor: float = Field(
        default=1.3, ge=1, le=5, description="Factor on the tolerance in the first refinement"
    )
    relief: float = Field(
        default=0.02, ge=0, le=0.2, description="Minimum relief around a voting point, in diameters"
    )
    min_pixels: float = Field(
        default=40.0,
        ge=5,
        le=1000,
        description="Minimum number of measurements along the diameter of the model",
    )
    references: int = Field(
        default=1500, ge=10, le=100_000, description="Maximum number of scene points that vote"
    )
    peaks: int = Field(default=3, ge=1, le=20, description="Hypotheses of each voting point")
    hypotheses: int = Field(default=400, ge=1, le=100_000, description="Hypotheses that are refined")
    finalists: int = Field(default=40, ge=2, le=1000, description="Distinct poses that are refined further")
    min_score: float = Field(
        default=0.75, gt=0, le=1, description="Score of the agreement with the view: FAILED below"
    )
    min_margin: float = Field(
        default=0.08, ge=0, le=1, description="Margin over the score of the best other pose: FAILED below"
    )
    min_outline: float = Field(
        default=0.25,
        ge=0,
        le=1,
        description="Fraction of the outline of a closed model, as far as it is not hidden, at which the "
        "scene behind it is deeper: FAILED below",
    )

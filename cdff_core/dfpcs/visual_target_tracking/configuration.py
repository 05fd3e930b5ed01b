# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualTargetTracking."""

from __future__ import annotations

from pydantic import Field

from cdff_core.object_models.image_tracking import ImageTrackingConfig


class VisualTargetTrackingConfig(ImageTrackingConfig):
    """Parameters of the tracker, and of the DFN slots."""

    min_shading_agreement: float = Field(
        0.5,
        gt=0,
        le=1,
        description="Fraction of the points tracked from the rendering that must agree with the pose",
    )
    min_correlation: float = Field(
        0.6,
        gt=0,
        le=1,
        description="Correlation of image and rendering on the body below which it is not used",
    )
    orientation_interval_s: float = Field(
        1.0,
        ge=0,
        le=1e6,
        description="Least time between images that are compared by the orientation of all edges if single "
        "edges do not agree; this takes one to three seconds",
    )

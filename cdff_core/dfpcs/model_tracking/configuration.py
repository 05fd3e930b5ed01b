# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of ModelTracking."""

from __future__ import annotations

from pydantic import Field

from cdff_core.object_models.depth_detection import DepthDetectionConfig
from cdff_core.object_models.image_tracking import ImageTrackingConfig


class ModelTrackingConfig(ImageTrackingConfig):
    """Parameters of the tracker, and of the DFN slots."""

    guess_sigma: float = Field(
        0.1,
        gt=0,
        le=1,
        description="Standard deviation of the position of a guess without covariance, in diameters",
    )
    guess_sigma_rad: float = Field(
        0.1, gt=0, le=3, description="Standard deviation of the rotation of a guess without covariance"
    )
    depth_delay_sigma: float = Field(
        0.3,
        ge=0,
        le=5,
        description="Standard deviation of the time between a depth image and the image of its stamp, in "
        "intervals of the images; 0 for cameras that are synchronised",
    )
    detect_after: int = Field(
        3,
        ge=1,
        le=1000,
        description="Consecutive images without use after which the object is detected, and images between "
        "two detections",
    )
    detection: DepthDetectionConfig = Field(
        DepthDetectionConfig(), description="Search and decision in a depth image"
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of map merging, in the profile; used by ``cdff_core.map_merging`` and its service."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel


class MergingConfig(StrictModel):
    """Selection and matching of the keyframes of two robots, and thresholds of frame revisions."""

    maps: Literal["lidar", "visual"] = Field(
        "lidar",
        description="Merged maps: pose graphs with clouds, or visual maps (product visual_map)",
    )
    matching: dict[str, Any] = Field({}, description="Parameters of PointCloudMatching; only for lidar maps")
    optimise: dict[str, Any] = Field({"robust": "gnc"}, description="Parameters of PoseGraphOptimization")
    search_radius_m: float = Field(
        12.0,
        gt=0.0,
        le=500.0,
        description="Largest distance of compared keyframes of two robots, metres",
    )
    candidates: int = Field(
        2, ge=1, le=20, description="Loop closures of a keyframe after which it is not compared further"
    )
    trials: int = Field(
        4, ge=1, le=100, description="Largest number of compared pairs before the result is evaluated"
    )
    cloud_radius_m: float = Field(
        25.0, gt=1.0, le=500.0, description="Radius of the local map of a keyframe that is compared, metres"
    )
    cloud_s: float = Field(
        8.0,
        gt=0.0,
        le=3600.0,
        description="Clouds up to this time before and after a keyframe belong to it, seconds",
    )
    cloud_points: int = Field(
        400_000, ge=1000, le=1_000_000, description="Largest number of points of a local map"
    )
    revision_distance_m: float = Field(
        0.005, gt=0.0, description="Displacement of a keyframe after which its frame is revised, metres"
    )
    revision_sigma_ratio: float = Field(
        0.8, gt=0.0, lt=1.0, description="Ratio of new to published sigma below which the frame is revised"
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of DigitalElevationMapping."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class DigitalElevationMappingConfig(DfpcConfig):
    """Cells, gates and periods."""

    resolution_m: float = Field(0.05, gt=0.0, le=1000.0, description="Edge of a cell, metres")
    patch_period_s: float = Field(2.0, gt=0.0, description="Mission time after which a patch is published, seconds")
    patch_distance_m: float = Field(2.0, gt=0.0, description="Distance after which a patch is published, metres")
    max_patch_points: int = Field(2_000_000, ge=1, description="Points after which a patch is published")
    min_range_m: float = Field(0.5, ge=0.0, description="Nearest point used, metres from the sensor")
    max_range_m: float | None = Field(
        None,
        gt=0.0,
        description="Farthest point used, metres from the sensor; absent: 240 cells in a sweep, else 100 m",
    )
    min_height_m: float | None = Field(None, description="Lowest point used, metres above the sensor; absent: any")
    max_height_m: float | None = Field(None, description="Highest point used, metres above the sensor; absent: any")
    range_sigma_m: float = Field(0.02, ge=0.0, description="Noise of a lidar's or cloud's range, metres, one sigma")
    stereo_distance_m: float = Field(0.3, ge=0.0, description="Motion after which the next pair is used, metres")
    stereo_period_s: float = Field(2.0, ge=0.0, description="Time after which the next pair is used anyway, seconds")
    stereo_min_period_s: float = Field(0.5, ge=0.0, description="Time before which no other pair is used, seconds")
    stereo_common: float = Field(
        0.3, ge=0.0, le=1.0, description="Share of a disparity's sigma that is its neighbours' too and never averages"
    )
    align: bool = Field(True, description="Whether sweeps and clouds are fitted to the local map")
    overhang_gap_m: float | None = Field(
        1.0, gt=0.0, description="Empty height in a cell above which all is an overhang, metres; absent: none"
    )
    max_rays: int = Field(20_000, ge=0, description="Rays of a patch that clear what they pass through; 0: none")
    far_factor: int = Field(
        4, ge=0, le=64, description="Size of the far map's cells, in cells of the map; 0: no far map"
    )
    max_waiting: int = Field(40, ge=1, le=10_000, description="Captures that may wait for poses")
    pose_history_s: float = Field(30.0, gt=0.0, description="How long poses are kept, seconds")
    max_cloud_points: int = Field(100_000, ge=1, description="Points of a published cloud")
    deskewing: dict[str, Any] = Field(default_factory=dict)
    rasterisation: dict[str, Any] = Field(default_factory=dict)
    registration: dict[str, Any] = Field(default_factory=dict)
    fusion: dict[str, Any] = Field(default_factory=dict)
    far_fusion: dict[str, Any] = Field(default_factory=dict)
    thinning: dict[str, Any] = Field(default_factory=dict)
    disparity: dict[str, Any] = Field(default_factory=dict)
    triangulation: dict[str, Any] = Field(default_factory=dict)

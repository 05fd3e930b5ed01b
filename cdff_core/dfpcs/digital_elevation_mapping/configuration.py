# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of DigitalElevationMapping."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class DigitalElevationMappingConfig(DfpcConfig):
    """Cells, gates and periods."""

    resolution_m: float = Field(0.05, gt=0.0, le=1000.0, description="Edge of a cell, metres")
    patch_period_s: float = Field(
        2.0, gt=0.0, description="Mission time after which a patch is published, seconds"
    )
    patch_distance_m: float = Field(
        2.0, gt=0.0, description="Motion after which a patch is published, metres"
    )
    max_patch_points: int = Field(2_000_000, ge=1, description="Points after which a patch is published")
    min_range_m: float = Field(0.5, ge=0.0, description="Smallest range of a point, metres")
    max_range_m: float | None = Field(
        None,
        gt=0.0,
        description="Largest range of a point, metres; absent: 240 cells in a sweep, else 100 m",
    )
    min_height_m: float | None = Field(
        None, description="Smallest height of a point above the sensor, metres; absent: any"
    )
    max_height_m: float | None = Field(
        None, description="Largest height of a point above the sensor, metres; absent: any"
    )
    range_sigma_m: float = Field(
        0.02, ge=0.0, description="Standard deviation of the range of lidars and clouds, metres"
    )
    stereo_distance_m: float = Field(0.3, ge=0.0, description="Motion between processed stereo pairs, metres")
    stereo_period_s: float = Field(
        2.0, ge=0.0, description="Longest time between processed stereo pairs, seconds"
    )
    align: bool = Field(True, description="Align sweeps and clouds with the local map")
    overhang_gap_m: float | None = Field(
        1.0,
        gt=0.0,
        description=(
            "Empty height below an overhang, metres; in cells larger than twice this, height of structure "
            "above the ground; absent: no overhangs"
        ),
    )
    max_rays: int = Field(
        20_000,
        ge=0,
        description="Maximum number of rays per patch that clear the cells they pass through; 0: none",
    )
    far_factor: int = Field(
        4, ge=0, le=64, description="Size of the far map's cells, in cells of the map; 0: no far map"
    )
    max_waiting: int = Field(
        40, ge=1, le=10_000, description="Length of the queue of captures that wait for poses"
    )
    max_cloud_points: int = Field(100_000, ge=1, description="Greatest number of points of a published cloud")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of the merging of maps: the profile states them, ``cdff_core.map_merging`` and its service use them."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel


class MergingConfig(StrictModel):
    """Which key frames of two robots are compared, what they are compared by, and what counts as news."""

    matching: dict[str, Any] = Field({}, description="Of PointCloudMatching")
    optimise: dict[str, Any] = Field({"robust": "gnc"}, description="Of PoseGraphOptimization")
    search_radius_m: float = Field(
        12.0, gt=0.0, le=500.0, description="Key frames of two robots so near to one another are compared, metres"
    )
    candidates: int = Field(
        2, ge=1, le=20, description="Closures wanted of each key frame; with so many it is compared no more"
    )
    trials: int = Field(
        4, ge=1, le=100, description="Pairs that are compared at most before the answer is looked at again"
    )
    cloud_radius_m: float = Field(
        25.0, gt=1.0, le=500.0, description="Surroundings of a key frame that are compared, metres"
    )
    cloud_s: float = Field(
        8.0, gt=0.0, le=3600.0, description="Clouds taken so long before and after a key frame count as its"
    )
    cloud_points: int = Field(400_000, ge=1000, le=1_000_000, description="Points of such surroundings at most")
    shift_m: float = Field(
        0.005, gt=0.0, description="A frame is revised when a key frame of its moves by this, metres"
    )
    sigma_share: float = Field(
        0.8, gt=0.0, lt=1.0, description="And when its sigma falls below this share of the one that is stated"
    )

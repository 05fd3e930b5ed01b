# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of TargetTracking."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class TargetTrackingConfig(DfpcConfig):
    """Parameters of the tracker, and of the DFN slots."""

    initial_velocity_sigma_mps: float = Field(
        0.3, gt=0, le=100, description="Standard deviation of the velocity of a new track"
    )
    initial_rate_sigma_radps: float = Field(
        0.2, gt=0, le=10, description="Standard deviation of the angular rate of a new track"
    )
    confirm_after: int = Field(
        3, ge=1, le=100, description="Number of used measurements from which the track is confirmed"
    )
    restart_after: int = Field(
        4,
        ge=2,
        le=100,
        description="Number of consecutive rejected measurements that agree and start a new track",
    )
    lost_after_s: float = Field(
        120.0, gt=0, le=1e5, description="Time without a used measurement after which the track is lost"
    )

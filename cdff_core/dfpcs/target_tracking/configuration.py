# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of TargetTracking."""

from __future__ import annotations

from pydantic import Field

from cdff_core.object_models.state_filter import NewTrackConfig


class TargetTrackingConfig(NewTrackConfig):
    """Parameters of the tracker, and of the DFN slots."""

    centre_of_mass_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Centre of mass in the frame of the body, metres"
    )
    centre_of_mass_sigma_m: float = Field(
        0.2, ge=0, le=1e4, description="Standard deviation of the centre of mass; 0 if it is known"
    )
    restart_after: int = Field(
        4,
        ge=2,
        le=100,
        description="Number of consecutive rejected measurements that agree and start a new track",
    )

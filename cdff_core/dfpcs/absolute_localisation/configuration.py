# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of AbsoluteLocalisation."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class AbsoluteLocalisationConfig(DfpcConfig):
    """Segments, search, drift and jumps. Drift is a random walk, given by its standard deviation."""

    segment_m: float = Field(30.0, gt=0.0, le=10_000.0, description="Path length of a segment, metres")
    map_m: float = Field(80.0, gt=0.0, le=10_000.0, description="Edge of the square map of a segment, metres")
    max_search_m: float | None = Field(
        None,
        gt=0.0,
        le=1e7,
        description="Largest searched translation, metres; absent: 60 cells of the orbital model, at least 60 m",
    )
    max_search_deg: float = Field(20.0, gt=0.0, le=180.0, description="Largest searched rotation, degrees")
    prior_m: float | None = Field(
        None,
        gt=0.0,
        description=(
            "Standard deviation of the first position without poses, metres; absent: 10 cells of the orbital "
            "model, at least 10 m"
        ),
    )
    prior_deg: float = Field(
        3.0, gt=0.0, le=180.0, description="Standard deviation of the first yaw without poses, degrees"
    )
    datum_m: float = Field(
        100.0, ge=0.0, description="Standard deviation of the orbital model's height datum, metres"
    )
    drift_m: float = Field(0.05, ge=0.0, description="Drift of x and y over a path of one metre, metres")
    drift_height_m: float = Field(
        0.004, ge=0.0, description="Drift of the height over a path of one metre, metres"
    )
    drift_deg: float = Field(0.12, ge=0.0, description="Drift of the yaw over a path of one metre, degrees")
    jump_m: float = Field(
        0.2, gt=0.0, description="Least translation of a jump of the frame of poses, beyond slip, metres"
    )
    jump_deg: float = Field(
        2.5, gt=0.0, le=180.0, description="Least yaw of such a jump, beyond that of skidding wheels, degrees"
    )

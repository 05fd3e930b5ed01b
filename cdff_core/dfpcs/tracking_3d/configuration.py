# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of Tracking3D."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class Tracking3DConfig(DfpcConfig):
    """Extent of the data and of predictions, and the parameters of the DFN slot."""

    max_poses: int = Field(600, ge=10, le=10000, description="Number of the newest poses that are used")
    refit_growth: float = Field(
        0.02, gt=0, le=1, description="Part of the number of poses by which it grows between two fits"
    )
    horizon_s: float = Field(60.0, gt=0, le=86400, description="Duration of predictions, s")
    step_s: float = Field(1.0, gt=0, le=3600, description="Interval of the states of a prediction, s")
    attitude_age_s: float = Field(
        2.0, gt=0, le=60, description="Largest time between a pose and the nearest attitude, s"
    )
    max_noise_factor: float = Field(
        4.0,
        ge=1,
        le=1000,
        description="Variance of the orientations by the stated one above which the state is DEGRADED",
    )
    max_outlier_ratio: float = Field(
        0.2, gt=0, le=1, description="Part of the poses that contradict the motion above which it is DEGRADED"
    )
    max_increment_rad: float = Field(
        2.6,
        gt=0,
        le=3.1416,
        description="Median rotation between poses, rad, above which the sense of rotation is ambiguous",
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualLocalisation."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class VisualLocalisationConfig(DfpcConfig):
    """Parameters of the DFN slots, of the search and of the estimate, and the gates of a result."""

    candidates: int = Field(6, ge=1, le=100, description="Keyframes that are compared with the image")
    clusters: int = Field(64, ge=2, le=1024, description="Clusters of descriptors of the place index")
    sigma_px: float = Field(
        0.7, gt=0, le=10, description="Standard deviation of a feature, pixels of a camera without distortion"
    )
    gate: float = Field(
        4.2, gt=1, le=20, description="Normalised residual beyond which a match has no weight"
    )
    min_inliers: int = Field(
        30, ge=6, le=10_000, description="Number of consistent matches below which a pose is refused"
    )
    min_inlier_ratio: float = Field(
        0.15,
        ge=0,
        le=1,
        description="Ratio of consistent matches to all matches below which a pose is refused",
    )
    max_sigma_m: float = Field(
        0.5, gt=0, description="Standard deviation of the position above which a pose is refused, metres"
    )
    correlation: float = Field(
        4.0,
        ge=1,
        le=100,
        description="Factor of the covariance: number of matches with one error, as on one object",
    )
    max_focal_error: float = Field(
        0.01,
        gt=0,
        le=1,
        description="Relative error of the stated focal length above which that of many images is reported",
    )

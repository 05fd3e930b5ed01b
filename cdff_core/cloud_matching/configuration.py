# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What every DFPC that matches clouds lets be configured alike."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.dfpc import DfpcConfig

Radii = tuple[Annotated[float, Field(ge=2.0, le=100.0)], ...]


class MatchingGates(StrictModel):
    """Scales in voxels of the matched clouds, how widely is searched, and the gates an answer must pass."""

    keypoint_voxels: float = Field(1.5, ge=1.0, le=50.0, description="Scale of the keypoints, in voxels")
    support_voxels: Radii = Field(
        (11.0, 8.0), min_length=1, max_length=8, description="Radii of the descriptors, in voxels, tried in turn"
    )
    candidates: int = Field(3, ge=1, le=20, description="Cliques of the matches that are tried, for each radius")
    noise_voxels: float = Field(1.0, gt=0.0, le=20.0, description="Noise of right pairs, in voxels")
    min_overlap: float = Field(0.2, gt=0, le=1, description="Larger of both overlaps below which it is FAILED")
    good_overlap: float = Field(0.3, gt=0, le=1, description="Larger of both overlaps below which it is DEGRADED")
    min_inlier_ratio: float = Field(0.5, gt=0, le=1, description="Share of pairs the kernel keeps, FAILED below")
    max_rms_gates: float = Field(0.25, gt=0, le=1, description="Residuals in gates of the overlap, FAILED above")
    min_agreement: float = Field(0.5, ge=0, le=1, description="Agreement of a direction below which it is FAILED")
    good_agreement: float = Field(0.7, ge=0, le=1, description="Agreement of a direction below which it is DEGRADED")
    max_chance: float = Field(1e-3, gt=0, description="Cliques expected among random matches, FAILED above")


class MatchingConfig(MatchingGates, DfpcConfig):
    """The same with the parameters of the DFN slots."""

    filter: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on the clouds as they come")
    thin: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for refinement and assessment")
    outliers: dict[str, Any] = Field({}, description="Of PointCloudFiltering, after thinning")
    normals: dict[str, Any] = Field({}, description="Of NormalsEstimation")
    keypoints: dict[str, Any] = Field({}, description="Of FeaturesExtraction3D")
    describe: dict[str, Any] = Field({}, description="Of FeaturesDescription3D")
    match: dict[str, Any] = Field({}, description="Of FeaturesMatching3D")
    solve: dict[str, Any] = Field({}, description="Of GlobalRegistration3D")
    refine: dict[str, Any] = Field({}, description="Of Registration3D")
    assess: dict[str, Any] = Field({}, description="Of RegistrationAssessment")

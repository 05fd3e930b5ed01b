# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters shared by the DFPCs that match point clouds."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel

Radii = tuple[Annotated[float, Field(ge=2.0, le=100.0)], ...]


class AcceptanceGates(StrictModel):
    """Gates that the assessment of a registration must pass."""

    min_overlap: float = Field(default=0.2, gt=0, le=1, description="Overlap: FAILED below")
    good_overlap: float = Field(default=0.3, gt=0, le=1, description="Overlap: DEGRADED below")
    min_inlier_ratio: float = Field(
        default=0.5,
        gt=0,
        le=1,
        description="Ratio of point pairs that the robust kernel accepts: FAILED below",
    )
    max_rms_to_gate_ratio: float = Field(
        default=0.25, gt=0, le=1, description="Ratio of the RMS residual to the overlap gate: FAILED above"
    )
    min_agreement: float = Field(
        default=0.5,
        ge=0,
        le=1,
        description="For each eigenvector of the pose information matrix: the fraction of its information "
        "that comes from points whose normals agree in both clouds (1: structure, 0: noise); FAILED below, "
        "for any eigenvector",
    )
    good_agreement: float = Field(
        default=0.7,
        ge=0,
        le=1,
        description="For each eigenvector of the pose information matrix: the fraction of its information "
        "that comes from points whose normals agree in both clouds (1: structure, 0: noise); DEGRADED below, "
        "for any eigenvector",
    )


class MatchingGates(AcceptanceGates):
    """Scales of the search in voxels of the matched clouds, and the gates of its result."""

    keypoint_voxels: float = Field(default=1.5, ge=1.0, le=50.0, description="Scale of keypoints, in voxels")
    support_voxels: Radii = Field(
        default=(11.0, 8.0),
        min_length=1,
        max_length=8,
        description="Radii of the descriptors, in voxels, in the order of their use",
    )
    max_cliques: int = Field(
        default=3, ge=1, le=20, description="Maximum number of cliques of matches registered per radius"
    )
    noise_voxels: float = Field(
        default=1.0, gt=0.0, le=20.0, description="Largest position error of a correct match, voxels"
    )
    max_roughnesses: float = Field(
        default=2.0,
        gt=0,
        description="Ratio of the RMS residual of the clouds thinned for matching to their joint roughness, "
        "both at the spacing of their points: FAILED above",
    )
    max_chance: float = Field(
        default=1e-3,
        gt=0,
        description="Expected number of cliques of this size among random matches: FAILED above",
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of LidarLocalisation."""

from __future__ import annotations

from typing import Any, Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import MatchingGates, Radii

Way = Literal["shape", "descriptors"]


class LidarLocalisationConfig(MatchingGates, DfpcConfig):
    """Parameters of the DFN slots, of map and prediction, and the gates an answer must pass."""

    range: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on the sweep")
    deskew: dict[str, Any] = Field({}, description="Of PointCloudDeskewing")
    increment: dict[str, Any] = Field({}, description="Of OdometryIncrement")
    thin_scan: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, of the sweep as it is matched")
    thin_coarse: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, of sweep and map from afar")
    normals: dict[str, Any] = Field({}, description="Of NormalsEstimation")
    register_coarse: dict[str, Any] = Field({}, description="Of Registration3D, from afar")
    refine: dict[str, Any] = Field({}, description="Of Registration3D")
    assess: dict[str, Any] = Field({}, description="Of RegistrationAssessment")
    estimate: dict[str, Any] = Field({}, description="Of PoseEstimation")
    search: dict[str, Any] = Field({}, description="Of PlaceSearch")
    filter: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on clouds that are described")
    thin: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, on clouds that are described")
    thin_matched: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for descriptors")
    outliers: dict[str, Any] = Field({}, description="Of PointCloudFiltering, on clouds that are described")
    keypoints: dict[str, Any] = Field({}, description="Of FeaturesExtraction3D")
    describe: dict[str, Any] = Field({}, description="Of FeaturesDescription3D")
    match: dict[str, Any] = Field({}, description="Of FeaturesMatching3D")
    solve: dict[str, Any] = Field({}, description="Of GlobalRegistration3D")
    # The map.
    voxel_m: float = Field(0.15, gt=0.0, le=10.0, description="Voxel of the scan map, metres")
    tile_m: float = Field(10.0, gt=0.1, le=1000.0, description="Edge of its tiles, metres")
    local_radius_m: float = Field(30.0, gt=1.0, le=1000.0, description="Radius of the local map, metres")
    local_reuse_m: float = Field(3.0, ge=0.0, le=100.0, description="Way after which it is cut out again, metres")
    key_frame_m: float = Field(2.0, gt=0.0, le=1000.0, description="Way between key frames of the drive, metres")
    # The prediction.
    guess_sigma_m: float = Field(1.0, gt=0.0, description="Of a guess without covariance, metres")
    guess_sigma_deg: float = Field(10.0, gt=0.0, le=90.0, description="Of a guess without covariance, degrees")
    step_sigma_m: float = Field(0.02, gt=0.0, description="Added to each prediction, metres")
    step_sigma_deg: float = Field(0.3, gt=0.0, description="Added to each prediction, degrees")
    drift_m_s: float = Field(0.5, gt=0.0, description="Of a prediction without odometry, metres a second")
    drift_deg_s: float = Field(10.0, gt=0.0, description="Of a prediction without odometry, degrees a second")
    odometry_wait_s: float = Field(0.3, ge=0.0, description="How much later odometry may come than a sweep")
    # The search of the whole map.
    relocalise_by: tuple[Way, ...] = Field(
        ("shape", "descriptors"), max_length=2, description="Ways to search the whole map, tried in turn"
    )
    descriptor_places: int = Field(1, ge=0, le=100, description="Parts of the map that are searched by descriptors")
    # Scales and gates that differ from those of clouds of one kind.
    support_voxels: Radii = Field(
        (12.0,), min_length=1, max_length=8, description="Radii of the descriptors, in voxels, tried in turn"
    )
    candidates: int = Field(1, ge=1, le=20, description="Cliques of the matches that are tried, for each radius")
    noise_voxels: float = Field(1.5, gt=0.0, le=20.0, description="Noise of right pairs, in voxels")
    min_overlap: float = Field(0.6, gt=0, le=1, description="Share of the sweep that lies on the map, FAILED below")
    good_overlap: float = Field(0.8, gt=0, le=1, description="Share of the sweep that lies on the map, DEGRADED below")
    min_inlier_ratio: float = Field(0.6, gt=0, le=1, description="Share of pairs the kernel keeps, FAILED below")
    good_agreement: float = Field(0.6, ge=0, le=1, description="Agreement of a direction below which it is weak")
    max_residual_m: float = Field(0.03, gt=0, description="Robust distance of the sweep from the map, FAILED above")
    max_coarse_residual_m: float = Field(0.06, gt=0, description="The same from afar, not looked at closely above")
    ambiguity: float = Field(1.5, ge=1, description="Another place is as good within this factor on the residuals")
    # The covariance, calibrated on simulated terrain: docs/dfpcs/lidar_localisation.md.
    covariance_scale: float = Field(1.0, gt=0.0, description="Factor on the covariance of the assessment")
    map_sigma_xy_m: float = Field(0.0087, ge=0.0, description="What errors of the map leave along x and y, metres")
    map_sigma_z_m: float = Field(0.0029, ge=0.0, description="The same along z, metres")
    map_sigma_tilt_deg: float = Field(0.0112, ge=0.0, description="The same about x and y, degrees")
    map_sigma_yaw_deg: float = Field(0.0332, ge=0.0, description="The same about z, degrees")
    free_sigma_m: float = Field(10.0, gt=0.0, description="Of a match along directions that are free, metres")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of LidarSlam."""

from __future__ import annotations

from typing import Any

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import MatchingGates


class LoopGates(MatchingGates):
    """Gates of a loop, which is right or none: what is only good enough for DEGRADED is refused."""

    candidates: int = Field(2, ge=1, le=20, description="Cliques of the matches that are tried, for each radius")
    min_overlap: float = Field(0.4, gt=0, le=1, description="Larger of both overlaps below which a loop is refused")
    good_overlap: float = Field(0.4, gt=0, le=1, description="As min_overlap")
    good_agreement: float = Field(0.5, ge=0, le=1, description="As min_agreement")


class LidarSlamConfig(DfpcConfig):
    """Parameters of the DFN slots, of the motion model, of key frames, and the gates that a loop must pass."""

    deskewing: dict[str, Any] = Field({}, description="Of PointCloudDeskewing")
    tracking: dict[str, Any] = Field({}, description="Of ScanToMapRegistration")
    thin_keyframe: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for clouds of key frames")
    thin_map: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for the whole map")
    detect: dict[str, Any] = Field({}, description="Of LoopDetection")
    filter: dict[str, Any] = Field({}, description="Of PointCloudFiltering, for clouds of key frames to be verified")
    thin: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for registration of key frames")
    thin_matched: dict[str, Any] = Field({}, description="Of PointCloudDownsampling, for descriptors")
    outliers: dict[str, Any] = Field({}, description="Of PointCloudFiltering, after thinning")
    normals: dict[str, Any] = Field({}, description="Of NormalsEstimation")
    keypoints: dict[str, Any] = Field({}, description="Of FeaturesExtraction3D")
    describe: dict[str, Any] = Field({}, description="Of FeaturesDescription3D")
    match: dict[str, Any] = Field({}, description="Of FeaturesMatching3D")
    solve: dict[str, Any] = Field({}, description="Of GlobalRegistration3D")
    refine: dict[str, Any] = Field({}, description="Of Registration3D")
    assess: dict[str, Any] = Field({}, description="Of RegistrationAssessment")
    optimise: dict[str, Any] = Field({}, description="Of PoseGraphOptimization")

    min_range_m: float = Field(0.5, ge=0.0, le=100.0, description="Points nearer than this are the robot's own")
    max_range_m: float = Field(60.0, gt=0.0, le=500.0, description="Points farther than this are left out")
    guess_sigma_m: float = Field(0.2, gt=0.0, description="Of a translation predicted from the motion before, metres")
    guess_sigma_rad: float = Field(0.05, gt=0.0, description="Of a rotation predicted from the motion before")
    wheels_sigma_m: float = Field(0.02, gt=0.0, description="Of a translation by the odometry: a part that is constant")
    wheels_share: float = Field(0.08, ge=0.0, le=1.0, description="Of a translation by the odometry: share of the way")
    wheels_yaw_sigma_rad: float = Field(0.01, gt=0.0, description="Of a turn about z by the odometry")
    wheels_age_s: float = Field(
        0.3, ge=0.0, le=10.0, description="Oldest odometry that tells the pose at a sweep's end"
    )
    sweep_sigma_m: float = Field(0.03, gt=0.0, description="Of the predicted translation during a sweep, metres")
    sweep_sigma_rad: float = Field(0.012, gt=0.0, description="Of the predicted rotation during a sweep")
    noise_share: float = Field(
        0.13, gt=0.0, le=100.0, description="Of a registration's covariance: what the pose of one sweep has"
    )
    noise_floor_m: float = Field(0.0018, ge=0.0, description="Least sigma of a translation on the map, metres")
    noise_floor_rad: float = Field(0.00025, ge=0.0, description="Least sigma of a rotation on the map")
    drift_share: float = Field(
        0.01, ge=0.0, le=100.0, description="Of the covariance of one sweep's pose: what adds up with each metre"
    )
    settling_m: float = Field(5.0, gt=0.0, le=100.0, description="Way on which a new map holds sweeps poorly, metres")
    settling_noise: float = Field(
        60.0, ge=0.0, description="What that adds to the covariance of a pose at its begin, in such covariances"
    )
    settling_drift: float = Field(
        0.75, ge=0.0, description="What adds up on it with each metre, in covariances of one sweep's pose"
    )
    weak_sigma_m: float = Field(0.09, gt=0.0, description="Sigma that the map leaves along a direction: DEGRADED above")
    min_inlier_ratio: float = Field(0.25, gt=0.0, le=1.0, description="Share of points on the map: DEGRADED below")
    lost_inlier_ratio: float = Field(0.05, gt=0.0, le=1.0, description="Share of points on the map: FAILED below")

    keyframe_distance_m: float = Field(5.0, gt=0.0, le=200.0, description="Way after which a key frame ends, metres")
    keyframe_range_m: float = Field(30.0, gt=0.0, le=500.0, description="Points that a key frame keeps, metres")
    reuse_distance_m: float = Field(3.0, ge=0.0, le=200.0, description="A key frame so near an old one goes up in it")
    search_radius_m: float = Field(
        12.0, gt=0.0, le=500.0, description="Key frames that the graph places so near are tried"
    )
    candidates: int = Field(2, ge=1, le=20, description="Key frames tried for each that ends")
    report_keyframes: bool = Field(
        False, description="Publish trajectory and graph with each key frame that ends, not only with each loop"
    )
    history: int = Field(
        20_000, ge=10, le=10_000_000, description="Poses of the trajectory kept; beyond, every other goes"
    )

    loops: LoopGates = Field(LoopGates(), description="What an alignment of two key frames must pass to be a loop")
    drift_allowed_m: float = Field(0.5, gt=0.0, description="A loop may differ from the graph by this, metres")
    drift_allowed_share: float = Field(0.03, ge=0.0, le=1.0, description="And by this share of the way round")
    turn_allowed_rad: float = Field(0.05, gt=0.0, description="A loop may differ from the graph by this turn")
    turn_allowed_rad_m: float = Field(0.001, ge=0.0, description="And by this for each metre of the way round")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of LidarSlam."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.dfpc import DfpcConfig


class MotionPrediction(StrictModel):
    """Prediction of the motion between two sweeps by the odometry port."""

    odometry_sigma_ratio: float = Field(
        default=0.08,
        ge=0.0,
        le=1.0,
        description="Standard deviation of a translation measured by the odometry, per metre of path length",
    )
    odometry_max_age_s: float = Field(
        default=0.3,
        ge=0.0,
        le=10.0,
        description="Maximum extrapolation of the odometry to the end of a sweep, seconds",
    )


class PoseNoise(StrictModel):
    """Covariance of a registered pose, calibrated for one lidar (docs/dfpcs/lidar_slam.md)."""

    ratio: float = Field(
        default=0.06,
        gt=0.0,
        le=100.0,
        description="Factor on the covariance of the registration in the covariance of the pose",
    )
    residual_ratio: float = Field(
        default=16.0,
        ge=0.0,
        le=1000.0,
        description="Factor on the covariance from residuals in the covariance of the pose",
    )
    floor_m: float = Field(
        default=0.0018, ge=0.0, description="Minimum standard deviation of a translation, metres"
    )
    floor_rad: float = Field(
        default=0.00025, ge=0.0, description="Minimum standard deviation of a rotation, radians"
    )
    drift_ratio: float = Field(
        default=0.01,
        ge=0.0,
        le=100.0,
        description="Covariance of the drift over one metre, relative to the covariance of a pose",
    )


class TrackingGates(StrictModel):
    """Bounds on a registration with the local map."""

    degenerate_sigma_m: float = Field(
        default=0.09,
        gt=0.0,
        description="Standard deviation above which a direction is degenerate, metres: DEGRADED",
    )
    min_inlier_ratio: float = Field(
        default=0.25, gt=0.0, le=1.0, description="Fraction of the points on the local map: DEGRADED below"
    )


class LoopGates(StrictModel):
    """Selection of loop candidates."""

    search_radius_m: float = Field(
        default=12.0,
        gt=0.0,
        le=500.0,
        description="Keyframes of the map within this distance are loop candidates, metres",
    )
    max_loop_candidates: int = Field(
        default=2,
        ge=1,
        le=20,
        description="Maximum number of keyframes that are compared with a completed keyframe",
    )


class LidarSlamConfig(DfpcConfig):
    """Parameters of the DFN slots, tracking, keyframes and loop closure."""

    min_range_m: float = Field(
        0.5, ge=0.0, le=100.0, description="Closer points are ignored (robot body), metres"
    )
    max_range_m: float = Field(60.0, gt=0.0, le=500.0, description="Farther points are ignored, metres")
    keyframe_distance_m: float = Field(
        5.0, gt=0.0, le=200.0, description="Distance after which a new keyframe starts, metres"
    )
    keyframe_range_m: float = Field(30.0, gt=0.0, le=500.0, description="Range of stored points, metres")
    merge_distance_m: float = Field(
        3.0,
        ge=0.0,
        le=200.0,
        description="Keyframes closer than this to an older one are replaced by it, metres",
    )
    report_keyframes: bool = Field(
        False, description="Publish trajectory and graph with each keyframe, not only after loop closures"
    )
    prediction: MotionPrediction = Field(MotionPrediction(), description="Prediction of the motion")
    noise: PoseNoise = Field(PoseNoise(), description="Covariance of a registered pose")
    gates: TrackingGates = Field(TrackingGates(), description="Bounds on the registration of a sweep")
    loops: LoopGates = Field(LoopGates(), description="Selection of loop candidates")

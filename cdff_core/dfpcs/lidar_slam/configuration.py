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
        description="Standard deviation of a translation by the odometry: ratio of the path length",
    )
    odometry_max_age_s: float = Field(
        default=0.3,
        ge=0.0,
        le=10.0,
        description="Maximum extrapolation of the odometry to the end of a sweep",
    )


class PoseNoise(StrictModel):
    """Covariance of a registered pose, calibrated for one lidar (docs/dfpcs/lidar_slam.md)."""

    ratio: float = Field(
        default=0.13,
        gt=0.0,
        le=100.0,
        description="Factor from the registration's covariance to that of the pose",
    )
    floor_m: float = Field(default=0.0018, ge=0.0, description="Minimum sigma of a translation")
    floor_rad: float = Field(default=0.00025, ge=0.0, description="Minimum sigma of a rotation")
    drift_ratio: float = Field(
        default=0.01, ge=0.0, le=100.0, description="Drift per metre, as a factor on the covariance of a pose"
    )


class TrackingGates(StrictModel):
    """Bounds on a registration with the local map."""

    degenerate_sigma_m: float = Field(
        default=0.09,
        gt=0.0,
        description="Standard deviation from which a direction is degenerate: DEGRADED above",
    )
    min_inlier_ratio: float = Field(
        default=0.25, gt=0.0, le=1.0, description="Ratio of points on the map: DEGRADED below"
    )


class LoopGates(StrictModel):
    """Selection of loop candidates."""

    search_radius_m: float = Field(
        default=12.0,
        gt=0.0,
        le=500.0,
        description="Keyframes within this distance in the graph are compared, metres",
    )
    candidates: int = Field(default=2, ge=1, le=20, description="Comparisons per completed keyframe")


class LidarSlamConfig(DfpcConfig):
    """Parameters of the DFN slots, tracking, keyframes and loop closure."""

    min_range_m: float = Field(0.5, ge=0.0, le=100.0, description="Closer points are ignored (robot body)")
    max_range_m: float = Field(60.0, gt=0.0, le=500.0, description="Farther points are ignored, metres")
    keyframe_distance_m: float = Field(
        5.0, gt=0.0, le=200.0, description="Distance after which a new keyframe starts, metres"
    )
    keyframe_range_m: float = Field(30.0, gt=0.0, le=500.0, description="Range of stored points, metres")
    merge_distance_m: float = Field(
        3.0, ge=0.0, le=200.0, description="Keyframes closer than this to an older one are replaced by it"
    )
    report_keyframes: bool = Field(False, description="Publish trajectory and graph with each keyframe, too")
    prediction: MotionPrediction = Field(MotionPrediction(), description="Prediction of the motion")
    noise: PoseNoise = Field(PoseNoise(), description="Covariance of a registered pose")
    gates: TrackingGates = Field(TrackingGates(), description="Bounds on the registration of a sweep")
    loops: LoopGates = Field(LoopGates(), description="Selection of loops")

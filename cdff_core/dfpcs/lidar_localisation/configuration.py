# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of LidarLocalisation."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig
from cdff_core.cloud_matching.configuration import MatchingGates, Radii

SearchMethod = Literal["shape", "descriptors"]


class LidarLocalisationConfig(MatchingGates, DfpcConfig):
    """Parameters of the DFN slots, map, prediction and search, and the gates that a match must pass."""

    # Map
    voxel_m: float = Field(0.15, gt=0.0, le=10.0, description="Voxel of the scan map, metres")
    local_radius_m: float = Field(30.0, gt=1.0, le=1000.0, description="Radius of the local map, metres")
    keyframe_distance_m: float = Field(
        2.0, gt=0.0, le=1000.0, description="Distance between keyframes, metres"
    )
    range_resolution_m: float = Field(
        0.005,
        gt=0.0,
        le=1.0,
        description="Range resolution of the sensor, metres; "
        "lower bound of the joint roughness of sweep and map",
    )
    # Prediction
    drift_m_s: float = Field(
        0.5, gt=0.0, description="Standard deviation of the velocity without odometry, metres per second"
    )
    drift_deg_s: float = Field(
        10.0, gt=0.0, description="Standard deviation of the rotation without odometry, degrees per second"
    )
    odometry_wait_s: float = Field(
        0.3, ge=0.0, description="Maximum time that a sweep waits for its odometry, seconds"
    )
    # Search of the whole map
    relocalise_by: tuple[SearchMethod, ...] = Field(
        ("shape", "descriptors"),
        max_length=2,
        description="Methods to search the whole map, in the order of their use",
    )
    # Scales and gates that differ from the shared defaults.
    support_voxels: Radii = Field(
        (12.0,),
        min_length=1,
        max_length=8,
        description="Radii of the descriptors, in voxels, in the order of their use",
    )
    max_cliques: int = Field(
        1, ge=1, le=20, description="Maximum number of cliques of matches registered per radius"
    )
    noise_voxels: float = Field(
        1.5, gt=0.0, le=20.0, description="Largest position error of a correct match, voxels"
    )
    min_overlap: float = Field(
        0.6, gt=0, le=1, description="Fraction of the sweep's points on the map: FAILED below"
    )
    good_overlap: float = Field(
        0.8, gt=0, le=1, description="Fraction of the sweep's points on the map: DEGRADED below"
    )
    min_inlier_ratio: float = Field(
        0.6, gt=0, le=1, description="Ratio of point pairs that the robust kernel accepts: FAILED below"
    )
    good_agreement: float = Field(
        0.6,
        ge=0,
        le=1,
        description="Fraction of the pose information along an eigenvector on which both clouds agree: "
        "DEGRADED below",
    )
    # Covariance, calibrated on simulated terrain: docs/dfpcs/lidar_localisation.md.
    map_sigma_xy_m: float = Field(
        0.0087, ge=0.0, description="Standard deviation of the map along x and y, metres"
    )
    map_sigma_z_m: float = Field(0.0029, ge=0.0, description="Standard deviation of the map along z, metres")
    map_sigma_tilt_deg: float = Field(
        0.0112, ge=0.0, description="Standard deviation of the map about x and y, degrees"
    )
    map_sigma_yaw_deg: float = Field(
        0.0332, ge=0.0, description="Standard deviation of the map about z, degrees"
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of Reconstruction3D."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from cdff_common.interfaces.dfpc import DfpcConfig


class Reconstruction3DConfig(DfpcConfig):
    """Noise of the sensors, extent of the surface and times of publication."""

    voxel_m: float | None = Field(
        None, gt=0, le=1e5, description="Edge of a voxel, m; default: of the first capture's points and noise"
    )
    pose_of: Literal["sensor", "body"] = Field(
        "sensor",
        description="Meaning of poses of other frames than the sensor's: T_model_sensor or T_sensor_body",
    )
    solve_poses: bool = Field(
        False,
        description="The captures show one unknown body without poses: each is registered with the surface",
    )
    body: str = Field(
        "",
        pattern=r"^([a-z][a-z0-9_]{0,30})?$",
        description="With solve_poses: name of the body, so that the surface is in the frame {body}/body",
    )
    images_registered: bool = Field(
        False, description="Images whose frame has no known transform are taken to be at the depth camera"
    )
    max_pose_gap_s: float = Field(
        0.5,
        gt=0,
        le=86400,
        description="Time from a capture to the previous or next pose, s, above which none is interpolated",
    )
    max_pose_sigma_m: float | None = Field(
        None, gt=0, le=1e6, description="Poses with a larger standard deviation of the position are excluded"
    )
    max_pose_sigma_rad: float | None = Field(
        None, gt=0, le=3, description="Poses with a larger standard deviation of the rotation are excluded"
    )
    depth_sigma_m: float = Field(
        0.001, gt=0, le=1000, description="Standard deviation of a depth at small distance, m"
    )
    depth_sigma_per_m: float = Field(
        0.0015, ge=0, le=1, description="Increase of the standard deviation of a depth by its square, 1/m"
    )
    range_sigma_m: float = Field(0.02, gt=0, le=1000, description="Standard deviation of lidar ranges, m")
    disparity_sigma_px: float = Field(
        0.3, gt=0, le=10, description="Standard deviation of the disparities of stereo pairs, px"
    )
    min_range_m: float = Field(0.05, ge=0, le=1e9, description="Distance below which points are excluded, m")
    max_range_m: float | None = Field(
        None, gt=0, le=1e9, description="Distance above which points are excluded, m; default: none"
    )
    max_step: float = Field(
        4.0,
        gt=1,
        le=100,
        description="Difference of the depths of neighbouring pixels, in widths of a pixel, that divides "
        "surfaces",
    )
    publish_every: int = Field(50, ge=1, le=100_000, description="Captures between two published surfaces")
    min_captures: int = Field(2, ge=2, le=1000, description="Captures below which there is no surface")
    max_refused: float = Field(
        0.5,
        gt=0,
        lt=1,
        description="Part of the captures that contradict the surface above which it is FAILED",
    )
    max_waiting: int = Field(
        20, ge=1, le=1000, description="Captures, and images, that wait for poses; the oldest is dropped"
    )

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Parameters of VisualSlam."""

from __future__ import annotations

from pydantic import Field

from cdff_common.interfaces.dfn import StrictModel
from cdff_common.interfaces.dfpc import DfpcConfig


class PoseGates(StrictModel):
    """Noise of a feature, and gates of the pose of an image relative to keyframes."""

    sigma_px: float = Field(default=0.7, gt=0, le=10, description="Standard deviation of a feature, pixels")
    gate: float = Field(
        default=4.2, gt=1, le=20, description="Normalised residual beyond which a match has no weight"
    )
    min_inliers: int = Field(
        default=20, ge=6, le=10_000, description="Number of consistent matches below which a pose is refused"
    )
    min_inlier_ratio: float = Field(
        default=0.12, ge=0, le=1, description="Ratio of consistent matches below which a pose is refused"
    )
    correlation: float = Field(
        default=4.0, ge=1, le=100, description="Factor of the covariance: number of matches with one error"
    )


class KeyframeSelection(StrictModel):
    """Conditions of a new keyframe."""

    overlap: float = Field(
        default=0.35,
        gt=0,
        le=1,
        description="Ratio of the keyframe's points in the image below which one is made",
    )
    translation_ratio: float = Field(
        default=0.1,
        gt=0,
        le=10,
        description="Distance from the keyframe above which one is made, in median depths",
    )
    rotation_deg: float = Field(
        default=10.0, gt=0, le=90, description="Rotation from the keyframe above which one is made, degrees"
    )
    min_points: int = Field(
        default=60,
        ge=20,
        le=10_000,
        description="Number of points with depth below which an image is no keyframe",
    )
    merge_ratio: float = Field(
        default=0.02,
        ge=0,
        le=1,
        description="Distance from an older keyframe below which it replaces the newer one, in median depths",
    )
    max_count: int = Field(
        default=2000,
        ge=10,
        le=100_000,
        description="Number of keyframes above which the nearest two are merged",
    )


class LoopGates(StrictModel):
    """Selection and gates of loop closures."""

    near: int = Field(default=2, ge=0, le=20, description="Near keyframes that are compared with a new one")
    similar: int = Field(
        default=2, ge=0, le=20, description="Similar keyframes that are compared with a new one"
    )
    min_inliers: int = Field(
        default=30, ge=6, le=10_000, description="Number of consistent matches below which a loop is refused"
    )
    drift_ratio: float = Field(
        default=0.05, gt=0, le=1, description="Largest drift of the position that a loop corrects, per metre"
    )


class VisualSlamConfig(DfpcConfig):
    """Parameters of the DFN slots, of poses, keyframes and loops."""

    depth_offset_m: tuple[float, float, float] = Field(
        (0.0, 0.0, 0.0), description="Position of the depth camera in the frame of the colour camera, metres"
    )
    clusters: int = Field(64, ge=2, le=1024, description="Clusters of descriptors of the place index")
    window: int = Field(6, ge=2, le=50, description="Keyframes that are adjusted after each new one")
    max_adjusted: int = Field(
        300, ge=2, le=2000, description="Number of keyframes above which not all are adjusted at the end"
    )
    poses: PoseGates = Field(PoseGates(), description="Gates of a pose")
    keyframes: KeyframeSelection = Field(KeyframeSelection(), description="Conditions of a keyframe")
    loops: LoopGates = Field(LoopGates(), description="Selection and gates of loop closures")

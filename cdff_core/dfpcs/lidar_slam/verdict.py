# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What the ground says of a pose, and along which directions it says nothing."""

from __future__ import annotations

import numpy as np

from cdff_core.dfns.scan_to_map_registration._interface import ScanToMapRegistrationOutputs
from cdff_core.dfpcs.lidar_slam.configuration import LidarSlamConfig
from cdff_core.dfpcs.lidar_slam.tracking import Tracked

_AXES = ("translation_x", "translation_y", "translation_z", "rotation_x", "rotation_y", "rotation_z")


def weak_directions(found: ScanToMapRegistrationOutputs, config: LidarSlamConfig) -> tuple[str, ...]:
    """Names of the components, in axes of the map, that are largest in directions without information."""
    weak = found.sigma_m > config.weak_sigma_m
    return tuple(dict.fromkeys(_AXES[int(np.argmax(np.abs(d)))] for d in found.directions[weak]))


def degraded_of(tracked: Tracked, config: LidarSlamConfig) -> tuple[str, ...]:
    """Reasons for which a pose is not as good as it could be."""
    found = tracked.registration
    if found is None:
        return ()
    reasons = [f"degenerate:{name}" for name in weak_directions(found, config)]
    if reasons:
        reasons.append("held_by:odometry" if tracked.by_odometry else "held_by:motion_before")
    if float(found.inlier_ratio) < config.min_inlier_ratio:
        reasons.append(f"few_inliers:{float(found.inlier_ratio):.2f}<{config.min_inlier_ratio:g}")
    if not bool(found.converged):
        reasons.append("not_converged")
    return tuple(reasons)


def metrics_of(tracked: Tracked) -> dict[str, float]:
    """Figures that the verdict rests on."""
    found = tracked.registration
    if found is None:
        return {}
    return {
        "inlier_ratio": float(found.inlier_ratio),
        "rms_m": float(found.rms_m),
        "iterations": float(found.iterations),
        "least_agreement": float(found.agreement.min()),
        "largest_sigma_m": float(min(found.sigma_m.max(), 1e6)),
    }

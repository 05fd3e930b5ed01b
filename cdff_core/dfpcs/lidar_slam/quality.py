# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Observability and quality metrics of a tracked sweep."""

from __future__ import annotations

from cdff_core.cloud_matching.acceptance import main_components
from cdff_core.dfpcs.lidar_slam.configuration import TrackingGates
from cdff_core.dfpcs.lidar_slam.scan_tracker import TrackingResult


def degradation_reasons(tracking: TrackingResult, gates: TrackingGates) -> tuple[str, ...]:
    """Return the reasons for DEGRADED; degenerate directions are named in axes of the odometry frame."""
    registration = tracking.registration
    if registration is None:
        return ()
    degenerate = registration.directions[registration.sigma_m > gates.degenerate_sigma_m]
    reasons = [f"degenerate:{name}" for name in main_components(degenerate)]
    if reasons:
        reasons.append(f"constrained_by:{'odometry' if tracking.used_odometry else 'constant_velocity'}")
    if registration.inlier_ratio < gates.min_inlier_ratio:
        reasons.append(f"few_inliers:{registration.inlier_ratio:.2f}<{gates.min_inlier_ratio:g}")
    if not registration.converged:
        reasons.append("not_converged")
    if tracking.is_mount_assumed:
        reasons.append("lidar_mount_unknown")
    return tuple(reasons)


def registration_metrics(tracking: TrackingResult) -> dict[str, float]:
    """Return the metrics of the registration; an empty dictionary without a registration."""
    registration = tracking.registration
    if registration is None:
        return {}
    return {
        "inlier_ratio": registration.inlier_ratio,
        "support_ratio": registration.support_ratio,
        "rms_m": registration.rms_m,
        "iterations": float(registration.iterations),
        "least_agreement": float(registration.agreement.min()),
        "largest_sigma_m": float(min(registration.sigma_m.max(), 1e6)),
    }

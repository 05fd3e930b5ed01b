# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of a registration from its assessment and the configured gates."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cdff_common.interfaces.product import CovarianceKind, Quality
from cdff_core.cloud_matching.configuration import AcceptanceGates, MatchingGates
from cdff_core.cloud_matching.matcher import Registration
from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentOutputs

#: Names of the components of a change of a pose, in the order of its covariance.
_POSE_COMPONENTS = (
    "translation_x",
    "translation_y",
    "translation_z",
    "rotation_x",
    "rotation_y",
    "rotation_z",
)


def registration_quality(registration: Registration, overlap: float, gates: MatchingGates) -> Quality:
    """Return FAILED, DEGRADED or OK; the gates of the overlap apply to ``overlap``."""
    chance = registration.metrics.get("expected_by_chance", 0.0)
    by_chance = [f"matches_by_chance:{chance:.1g}>{gates.max_chance:g}"] if chance > gates.max_chance else []
    failed, degraded = gate_reasons(
        registration.assessment,
        overlap,
        gates,
        registration.step.converged,
        failed=by_chance,
        direction_names=main_components,
    )
    metrics = {**registration.metrics, **_assessment_metrics(registration)}
    return Quality.from_reasons(degraded, CovarianceKind.FORMAL, metrics, failed=failed)


def gate_reasons(
    assessment: RegistrationAssessmentOutputs,
    overlap: float,
    gates: AcceptanceGates,
    converged: bool,
    *,
    failed: Sequence[str] = (),
    direction_names: Callable[[NDArray[np.float64]], list[str]],
) -> tuple[list[str], list[str]]:
    """Return the reasons for FAILED, which end with those in ``failed``, and the reasons for DEGRADED.

    ``direction_names`` names the rows of an array of directions ``(k, 6)``.
    """
    a = assessment
    failures, degraded = [], []
    if overlap < gates.min_overlap:
        failures.append(f"low_overlap:{overlap:.2f}<{gates.min_overlap:g}")
    elif overlap < gates.good_overlap:
        degraded.append(f"low_overlap:{overlap:.2f}<{gates.good_overlap:g}")
    if a.inlier_ratio < gates.min_inlier_ratio:
        failures.append(f"few_inliers:{a.inlier_ratio:.2f}<{gates.min_inlier_ratio:g}")
    if a.rms_m > gates.max_rms_to_gate_ratio * a.gate_m:
        failures.append(f"large_residuals:{a.rms_m:.3g}m")
    failures += failed
    is_degenerate = a.agreement < gates.min_agreement
    is_weak = ~is_degenerate & (a.agreement < gates.good_agreement)
    failures += [f"degenerate:{name}" for name in direction_names(a.directions[is_degenerate])]
    degraded += [f"weak:{name}" for name in direction_names(a.directions[is_weak])]
    if not converged:
        degraded.append("not_converged")
    return failures, degraded


def main_components(directions: NDArray[np.float64]) -> list[str]:
    """Return the name of the largest component of each direction ``(k, 6)``, without repetition."""
    return list(dict.fromkeys(_POSE_COMPONENTS[int(np.argmax(np.abs(d)))] for d in directions))


def _assessment_metrics(registration: Registration) -> dict[str, float]:
    """Return the quantities of an assessment as metrics of a product."""
    a = registration.assessment
    return {
        "overlap_source": a.overlap_source,
        "overlap_target": a.overlap_target,
        "inlier_ratio": a.inlier_ratio,
        "rms_m": a.rms_m,
        "gate_m": a.gate_m,
        "condition_number": float(a.information[-1] / a.information[0]),
        "least_agreement": float(a.agreement.min()),
        "refinement_m": registration.refinement_m,
    }

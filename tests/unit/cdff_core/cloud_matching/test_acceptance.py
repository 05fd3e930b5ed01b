# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Quality of a registration: each gate at its limit, and on both sides of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from cdff_common.interfaces.product import Quality, Status
from cdff_core.cloud_matching.acceptance import gate_reasons, main_components, registration_quality
from cdff_core.cloud_matching.configuration import MatchingGates
from cdff_core.cloud_matching.matcher import Registration
from cdff_core.dfns.registration_3d.interface import Registration3DOutputs
from cdff_core.dfns.registration_assessment.interface import RegistrationAssessmentOutputs

GATES = MatchingGates(
    min_overlap=0.25, good_overlap=0.5, min_inlier_ratio=0.5, max_rms_to_gate_ratio=0.25, min_agreement=0.5,
    good_agreement=0.75, max_chance=0.125,
)  # fmt: skip
#: Passes all gates, each exactly at its limit.
AT_LIMITS = RegistrationAssessmentOutputs(
    covariance=np.eye(6),
    overlap_source=0.5,
    overlap_target=0.375,
    inlier_ratio=0.5,
    rms_m=0.5,
    gate_m=2.0,
    centre_m=np.zeros(3),
    radius_m=1.0,
    directions=np.eye(6),
    information=np.array([2.0, 3, 4, 5, 6, 16]),
    agreement=np.full(6, 0.75),
)


def quality(
    overlap: float = 0.5, converged: bool = True, chance: float = 0.125, **changes: object
) -> Quality:
    step = Registration3DOutputs(transform=np.eye(4), residual_scale_m=0.1, iterations=1, converged=converged)
    registration = Registration(
        step,
        replace(AT_LIMITS, **changes),
        0.5,
        {"expected_by_chance": chance},  # type: ignore[arg-type]
    )
    return registration_quality(registration, overlap, GATES)


def test_a_registration_at_all_limits_is_accepted() -> None:
    accepted = quality()
    assert (accepted.status, accepted.reasons) == (Status.OK, ())
    assert accepted.metrics["condition_number"] == 8.0
    assert accepted.metrics["least_agreement"] == 0.75
    assert (accepted.metrics["overlap_source"], accepted.metrics["overlap_target"]) == (0.5, 0.375)
    assert (accepted.metrics["rms_m"], accepted.metrics["gate_m"]) == (0.5, 2.0)
    assert (accepted.metrics["inlier_ratio"], accepted.metrics["refinement_m"]) == (0.5, 0.5)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"overlap": 0.24}, "low_overlap:0.24<0.25"),
        ({"inlier_ratio": 0.49}, "few_inliers:0.49<0.5"),
        ({"rms_m": 0.51}, "large_residuals:0.51m"),
        ({"chance": 0.25}, "matches_by_chance:0.2>0.125"),
        ({"agreement": np.array([0.75, 0.75, 0.75, 0.75, 0.49, 0.75])}, "degenerate:rotation_y"),
    ],
)
def test_a_value_beyond_its_limit_is_a_failure(changes: dict[str, object], reason: str) -> None:
    failed = quality(**changes)  # type: ignore[arg-type]
    assert (failed.status, failed.reasons) == (Status.FAILED, (reason,))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"overlap": 0.49}, "low_overlap:0.49<0.5"),
        ({"overlap": 0.25}, "low_overlap:0.25<0.5"),
        ({"converged": False}, "not_converged"),
        ({"agreement": np.array([0.74, 0.75, 0.75, 0.75, 0.75, 0.75])}, "weak:translation_x"),
        ({"agreement": np.array([0.75, 0.75, 0.5, 0.75, 0.75, 0.75])}, "weak:translation_z"),
    ],
)
def test_a_value_between_two_limits_is_degraded(changes: dict[str, object], reason: str) -> None:
    degraded = quality(**changes)  # type: ignore[arg-type]
    assert (degraded.status, degraded.reasons) == (Status.DEGRADED, (reason,))


def test_further_failures_follow_those_of_the_gates() -> None:
    failures, degraded = gate_reasons(
        replace(AT_LIMITS, rms_m=9.0), 0.5, GATES, False, failed=["other"], direction_names=main_components
    )
    assert failures == ["large_residuals:9m", "other"]
    assert degraded == ["not_converged"]


def test_directions_are_named_once_by_their_largest_component() -> None:
    directions = np.array([[0.1, -0.9, 0.2, 0, 0, 0.3], [0.1, 0.8, 0, 0, 0, 0], [0, 0, 0, 0.2, 0, -0.5]])
    assert main_components(directions) == ["translation_y", "rotation_z"]

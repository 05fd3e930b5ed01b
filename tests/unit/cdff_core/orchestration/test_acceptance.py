# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Assessment of candidates, and selection of the best one."""

from __future__ import annotations

from dataclasses import replace

from cdff_common.geometry.region import parse_region
from cdff_core.orchestration.acceptance import (
    Assessment,
    ProductCandidate,
    assess,
    best_candidate,
    delivery_summary,
)
from cdff_core.orchestration.request import ProductRequest

NOW_NS = 1_000_000_000_000
REQUEST = ProductRequest(
    "r",
    "dem",
    "mana",
    region=parse_region("circle:0,0,5"),
    max_age_s=60.0,
    resolution_m=0.05,
    min_coverage=0.5,
)
GOOD = ProductCandidate("a", "mana", NOW_NS - 10_000_000_000, NOW_NS - 90_000_000_000, 0.05, 0.8)


def test_a_candidate_that_meets_every_criterion_is_accepted() -> None:
    assert assess(GOOD, REQUEST, NOW_NS).satisfies


def test_the_age_of_a_map_is_that_of_its_newest_patch_and_the_oldest_age_is_stated() -> None:
    summary = delivery_summary(GOOD, assess(GOOD, REQUEST, NOW_NS), NOW_NS, "site")
    assert (summary["age_s"], summary["oldest_age_s"]) == (10.0, 90.0)
    assert summary["differences"] == []


def test_old_sparse_or_failed_candidates_violate_mandatory_criteria() -> None:
    for fault, word in (
        ({"t1_ns": NOW_NS - 61_000_000_000}, "age"),
        ({"coverage": 0.4}, "coverage"),
        ({"coverage": 0.0}, "nothing in the region"),
        ({"status": "FAILED"}, "FAILED"),
        ({"t1_ns": NOW_NS + 60_000_000_000}, "ahead of the mission clock"),
    ):
        assessment = assess(replace(GOOD, **fault), REQUEST, NOW_NS)  # type: ignore[arg-type]
        assert not assessment.acceptable
        assert word in assessment.violations[0]


def test_coarser_cells_are_delivered_and_reported_as_coarser() -> None:
    assessment = assess(replace(GOOD, resolution_m=0.1), REQUEST, NOW_NS)
    assert assessment.acceptable
    assert not assessment.satisfies
    assert "0.1 m" in assessment.shortfalls[0]


def test_a_resolution_is_compared_only_if_it_is_requested_and_known() -> None:
    for requested_m, actual_m in ((None, 0.5), (0.5, None), (None, None)):
        request = replace(REQUEST, resolution_m=requested_m)
        assert assess(replace(GOOD, resolution_m=actual_m), request, NOW_NS) == Assessment((), (), ())


def test_a_degraded_product_may_be_delivered() -> None:
    assert assess(replace(GOOD, status="DEGRADED"), REQUEST, NOW_NS).satisfies


def test_candidates_are_ranked_by_violations_then_coverage_then_age() -> None:
    stale = replace(GOOD, id="stale", t1_ns=NOW_NS - 100_000_000_000)
    wide = replace(GOOD, id="wide", coverage=0.9)
    recent = replace(GOOD, id="recent", t1_ns=NOW_NS)
    coarse = replace(GOOD, id="coarse", resolution_m=1.0, coverage=1.0)
    cases: tuple[tuple[list[ProductCandidate], str], ...] = (
        ([stale, GOOD, coarse], "a"),
        ([GOOD, wide, recent], "wide"),
        ([GOOD, recent], "recent"),
        ([stale, coarse], "coarse"),
    )
    for candidates, expected_id in cases:
        choice = best_candidate(candidates, REQUEST, NOW_NS)
        assert choice is not None
        assert choice[0].id == expected_id
    assert best_candidate([], REQUEST, NOW_NS) is None


def test_a_pose_at_a_given_time_has_no_age_limit() -> None:
    request = ProductRequest("r", "pose", "mana", t_ns=5_000_000, max_age_s=1.0)
    assert assess(ProductCandidate("", "mana", 5_000_000, 5_000_000), request, NOW_NS).satisfies


def test_finer_cells_that_cannot_be_aggregated_are_reported_but_accepted() -> None:
    request = replace(REQUEST, resolution_m=0.07)
    assessment = assess(GOOD, request, NOW_NS)
    assert assessment.satisfies
    differences = delivery_summary(GOOD, assessment, NOW_NS, "site")["differences"]
    assert isinstance(differences, list)
    assert "0.05 m, asked 0.07 m" in differences[0]


def test_partial_coverage_and_degraded_status_are_reported() -> None:
    request = replace(REQUEST, min_coverage=0.0)
    assessment = assess(replace(GOOD, status="DEGRADED"), request, NOW_NS)
    assert assessment.satisfies
    assert assessment.differences == [
        "status: DEGRADED, see its quality",
        "coverage: 0.800 of the region holds data",
    ]
    assert assess(replace(GOOD, coverage=1.0), request, NOW_NS).differences == []


def test_a_candidate_exactly_at_each_limit_is_accepted_and_one_just_beyond_is_not() -> None:
    s = 1_000_000_000
    at_limit = (
        {"t1_ns": NOW_NS - 60 * s},
        {"t1_ns": NOW_NS + 2 * s},
        {"coverage": 0.5},
        {"resolution_m": 0.05 * 1.0009},
    )
    beyond = (
        {"t1_ns": NOW_NS - 60 * s - 1},
        {"t1_ns": NOW_NS + 2 * s + 1},
        {"coverage": 0.4999},
        {"resolution_m": 0.05 * 1.0011},
    )
    for fields in at_limit:
        assert assess(replace(GOOD, **fields), REQUEST, NOW_NS).unmet == ""  # type: ignore[arg-type]
    for fields in beyond:
        assert not assess(replace(GOOD, **fields), REQUEST, NOW_NS).satisfies  # type: ignore[arg-type]


def test_a_product_ahead_of_the_clock_has_a_negative_age_and_is_remarked() -> None:
    ahead = replace(GOOD, t1_ns=NOW_NS + 1_000_000_000, oldest_t1_ns=NOW_NS + 500_000_000)
    assessment = assess(ahead, REQUEST, NOW_NS)
    assert assessment.satisfies
    assert assessment.differences == [
        "time: ahead of the mission clock by 1.000 s; the clock of a sensor is wrong"
    ]
    delivered = delivery_summary(ahead, assessment, NOW_NS, "site")
    assert (delivered["age_s"], delivered["oldest_age_s"]) == (-1.0, -0.5)


def test_the_age_of_a_map_at_a_requested_time_is_relative_to_that_time() -> None:
    request = replace(REQUEST, t_ns=NOW_NS - 40_000_000_000)
    assert assess(replace(GOOD, t1_ns=NOW_NS - 100_000_000_000), request, NOW_NS).satisfies
    assert "ahead" in assess(GOOD, request, NOW_NS).unmet


def test_coverage_is_not_assessed_without_region_or_coverage() -> None:
    for candidate, request in (
        (replace(GOOD, coverage=None), REQUEST),
        (replace(GOOD, coverage=0.0), replace(REQUEST, region=None)),
    ):
        assert assess(candidate, request, NOW_NS).differences == []


def test_the_age_of_a_capture_ahead_of_the_clock_is_negative() -> None:
    ahead = replace(GOOD, t1_ns=NOW_NS + 5, oldest_t1_ns=NOW_NS + 4)
    assert (ahead.age_s(NOW_NS), ahead.oldest_age_s(NOW_NS)) == (-5e-9, -4e-9)


def test_equal_candidates_are_ranked_by_id_and_fewer_shortfalls_come_before_coverage() -> None:
    fine = replace(GOOD, id="z")
    coarse = replace(GOOD, id="b", resolution_m=1.0, coverage=1.0)
    for candidates, expected_id in (([fine, GOOD], "a"), ([coarse, fine], "z")):
        choice = best_candidate(candidates, REQUEST, NOW_NS)
        assert choice is not None
        assert choice[0].id == expected_id


def test_a_delivery_states_robot_frame_resolution_coverage_and_status() -> None:
    summary = delivery_summary(GOOD, assess(GOOD, REQUEST, NOW_NS), NOW_NS, "site")
    fields = ("robot", "frame", "resolution_m", "coverage", "status")
    assert tuple(summary[name] for name in fields) == ("mana", "site", 0.05, 0.8, "OK")


def test_a_candidate_of_unknown_coverage_comes_after_one_of_known_coverage() -> None:
    anywhere = replace(REQUEST, region=None, min_coverage=None)
    unknown = replace(GOOD, id="unknown", coverage=None, t1_ns=NOW_NS)
    best = best_candidate([unknown, GOOD], anywhere, NOW_NS)
    assert best is not None
    assert best[0].id == GOOD.id

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What may be delivered, what is worth waiting for, and which of several is best."""

from __future__ import annotations

from dataclasses import replace

from cdff_common.geometry.region import parse_region
from cdff_core.orchestration.judge import Candidate, best, delivered, judge
from cdff_core.orchestration.request import ProductRequest

NOW_NS = 1_000_000_000_000
REQUEST = ProductRequest(
    "r", "dem", "mana", region=parse_region("circle:0,0,5"), max_age_s=60.0, resolution_m=0.05, min_coverage=0.5
)
GOOD = Candidate("a", "mana", NOW_NS - 10_000_000_000, NOW_NS - 90_000_000_000, 0.05, 0.8)


def test_a_candidate_that_is_as_asked_satisfies() -> None:
    assert judge(GOOD, REQUEST, NOW_NS).satisfies


def test_the_age_of_a_map_is_that_of_its_newest_patch_and_the_oldest_is_stated() -> None:
    what = delivered(GOOD, judge(GOOD, REQUEST, NOW_NS), REQUEST, NOW_NS, "site")
    assert (what["age_s"], what["oldest_age_s"]) == (10.0, 90.0)
    assert what["differences"] == []


def test_old_thin_or_failed_ones_are_missing_something_mandatory() -> None:
    for fault, word in (
        ({"t1_ns": NOW_NS - 61_000_000_000}, "age"),
        ({"coverage": 0.4}, "coverage"),
        ({"coverage": 0.0}, "nothing in the region"),
        ({"status": "FAILED"}, "FAILED"),
        ({"t1_ns": NOW_NS + 60_000_000_000}, "ahead of the mission clock"),
    ):
        judgement = judge(replace(GOOD, **fault), REQUEST, NOW_NS)  # type: ignore[arg-type]
        assert not judgement.acceptable
        assert word in judgement.missing[0]


def test_coarser_cells_are_delivered_and_said_to_be_coarser() -> None:
    judgement = judge(replace(GOOD, resolution_m=0.1), REQUEST, NOW_NS)
    assert judgement.acceptable
    assert not judgement.satisfies
    assert "0.1 m" in judgement.short[0]


def test_a_degraded_product_may_be_delivered() -> None:
    assert judge(replace(GOOD, status="DEGRADED"), REQUEST, NOW_NS).satisfies


def test_the_best_lacks_least_then_covers_most_then_is_youngest() -> None:
    stale = replace(GOOD, id="stale", t1_ns=NOW_NS - 100_000_000_000)
    wide = replace(GOOD, id="wide", coverage=0.9)
    young = replace(GOOD, id="young", t1_ns=NOW_NS)
    coarse = replace(GOOD, id="coarse", resolution_m=1.0, coverage=1.0)
    cases: tuple[tuple[list[Candidate], str], ...] = (
        ([stale, GOOD, coarse], "a"), ([GOOD, wide, young], "wide"), ([GOOD, young], "young"),
        ([stale, coarse], "coarse"),
    )  # fmt: skip
    for among, wanted in cases:
        choice = best(among, REQUEST, NOW_NS)
        assert choice is not None
        assert choice[0].id == wanted
    assert best([], REQUEST, NOW_NS) is None


def test_a_pose_at_a_given_time_has_no_age_limit() -> None:
    request = ProductRequest("r", "pose", "mana", t_ns=5_000_000, max_age_s=1.0)
    assert judge(Candidate("", "mana", 5_000_000, 5_000_000), request, NOW_NS).satisfies


def test_finer_cells_that_do_not_add_up_to_what_was_asked_are_said_but_not_waited_for() -> None:
    asked = replace(REQUEST, resolution_m=0.07)
    judgement = judge(GOOD, asked, NOW_NS)
    assert judgement.satisfies
    differences = delivered(GOOD, judgement, asked, NOW_NS, "site")["differences"]
    assert isinstance(differences, list)
    assert "0.05 m, asked 0.07 m" in differences[0]


def test_a_region_that_is_covered_in_part_and_a_degraded_status_are_said() -> None:
    asked = replace(REQUEST, min_coverage=0.0)
    judgement = judge(replace(GOOD, status="DEGRADED"), asked, NOW_NS)
    assert judgement.satisfies
    assert judgement.differences == [
        "status: DEGRADED, as its quality says", "coverage: 0.800 of the region holds data",
    ]  # fmt: skip
    assert judge(replace(GOOD, coverage=1.0), asked, NOW_NS).differences == []

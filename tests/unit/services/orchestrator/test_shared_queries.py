# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Identical requests look together."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

from cdff_common.clock import ManualClock, monotonic_s
from cdff_common.errors import DeadlineError, UnavailableError
from cdff_core.orchestration.acceptance import Assessment, ProductCandidate
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.shared_queries import Result, SharedQueries, query_key

A = ProductRequest("a", "pose", "mana", max_age_s=10.0)
S = 1_000_000_000


class Asked:
    """A finder that counts."""

    def __init__(self, result: Result | Exception = (None, "nothing")) -> None:
        self.times, self.result = 0, result

    def __call__(self) -> Result:
        self.times += 1
        if isinstance(self.result, Exception):
            raise self.result
        return self.result


def soon() -> float:
    return monotonic_s() + 10.0


@pytest.mark.req("CDFF-SUP-071")
def test_equivalent_requests_share_one_query_until_an_insertion() -> None:
    looks, asked = SharedQueries(ManualClock(0)), Asked()
    b = replace(A, id="b", deadline_s=2.0, priority=9, format="tum", deliver="reference")
    with looks.share(A), looks.share(b):
        assert len(looks) == 1
        for request in (A, b, A):
            assert looks.find(request, asked, 3, 100.0, soon()) == (None, "nothing")
        assert asked.times == 1
        looks.find(b, asked, 4, 100.0, soon())
        looks.find(A, asked, 3, 100.0, soon())
        assert asked.times == 2
        looks.find(A, asked, 4, -1.0, soon())
        assert asked.times == 3
    assert len(looks) == 0


def test_shared_query_results_are_evaluated_at_the_present_time() -> None:
    clock = ManualClock(5 * S)
    result = ProductMatch(ProductCandidate("id", "mana", 4 * S, 4 * S), (), None, "site")
    looks, asked = SharedQueries(clock), Asked(((result, Assessment()), ""))
    with looks.share(A):
        assert looks.find(A, asked, 0, 100.0, soon())[1] == ""
        clock.set_ns(60 * S)
        again, why = looks.find(A, asked, 0, 100.0, soon())
    assert asked.times == 1
    assert again is not None
    assert not again[1].acceptable
    assert "age" in why


def test_an_unavailable_dpm_is_queried_once_for_all_requests() -> None:
    looks, asked = SharedQueries(ManualClock(0)), Asked(UnavailableError("away"))
    with looks.share(A):
        for _ in range(3):
            with pytest.raises(UnavailableError, match="away"):
                looks.find(A, asked, 0, 100.0, soon())
    assert asked.times == 1


def test_a_query_that_missed_its_own_deadline_is_not_shared() -> None:
    looks, late, asked = SharedQueries(ManualClock(0)), Asked(DeadlineError("late")), Asked()
    with looks.share(A):
        with pytest.raises(DeadlineError):
            looks.find(A, late, 0, 100.0, soon())
        assert looks.find(A, asked, 0, 100.0, soon()) == (None, "nothing")


def test_a_request_without_time_for_the_query_of_another_is_refused() -> None:
    looks, inside, leave = SharedQueries(ManualClock(0)), threading.Event(), threading.Event()

    def slow() -> Result:
        inside.set()
        leave.wait(10)
        return None, "slow"

    with looks.share(A):
        thread = threading.Thread(target=looks.find, args=(A, slow, 0, 100.0, soon()))
        thread.start()
        assert inside.wait(10)
        with pytest.raises(DeadlineError, match="equivalent"):
            looks.find(A, Asked(), 0, 100.0, monotonic_s() + 0.05)
        leave.set()
        thread.join(10)


def test_different_requests_do_not_share() -> None:
    base = {"type": "dem", "region": "circle:0,0,5"}
    one = query_key(parse_request(base, "mana"))
    assert query_key(parse_request({**base, "format": "tif", "deadline_ms": "1000"}, "mana")) == one
    for more in (
        {"resolution_m": "0.1"},
        {"region": "circle:0,0,6"},
        {"max_age_s": "3"},
        {"min_coverage": "0.5"},
    ):
        assert query_key(parse_request({**base, **more}, "mana")) != one
    assert query_key(parse_request(base, "minnie")) != one
    poses = [query_key(parse_request({"type": "pose", "frame": f}, "mana")) for f in ("site", "mana/odom")]
    assert poses[0] != poses[1]

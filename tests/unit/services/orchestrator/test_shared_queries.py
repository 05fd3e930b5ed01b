# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Equivalent requests share one search of the DPM."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import Any

import pytest

from cdff_common.clock import ManualClock, monotonic_s
from cdff_common.errors import DeadlineError, UnavailableError
from cdff_core.orchestration.acceptance import Assessment, ProductCandidate
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.product_finder import ProductMatch
from services.orchestrator.shared_queries import Result, SharedQueries, query_key

A = ProductRequest("a", "pose", "mana", max_age_s=10.0)
S = 1_000_000_000


class CountingSearch:
    """Search double that counts its calls."""

    def __init__(self, result: Result | Exception = (None, "nothing")) -> None:
        self.count, self.result = 0, result

    def __call__(self) -> Result:
        self.count += 1
        if isinstance(self.result, Exception):
            raise self.result
        return self.result


def find(queries: SharedQueries, *arguments: Any) -> Result:
    """Return the result of a query; wait in this thread where it pauses."""
    steps = queries.find(*arguments)
    while True:
        try:
            next(steps).wait()
        except StopIteration as end:
            result: Result = end.value
            return result


def soon() -> float:
    """Return a deadline 10 s from now."""
    return monotonic_s() + 10.0


@pytest.mark.req("CDFF-SUP-071")
def test_equivalent_requests_share_one_query_until_an_insertion() -> None:
    queries, search = SharedQueries(ManualClock(0)), CountingSearch()
    b = replace(A, id="b", deadline_s=2.0, priority=9, format="tum", deliver="reference")
    with queries.share(A), queries.share(b):
        assert len(queries) == 1
        for request in (A, b, A):
            assert find(queries, request, search, 3, 100.0, soon()) == (None, "nothing")
        assert search.count == 1
        find(queries, b, search, 4, 100.0, soon())
        find(queries, A, search, 3, 100.0, soon())
        assert search.count == 2
        find(queries, A, search, 4, -1.0, soon())
        assert search.count == 3
    assert len(queries) == 0


def test_shared_query_results_are_evaluated_at_the_present_time() -> None:
    clock = ManualClock(5 * S)
    result = ProductMatch(ProductCandidate("id", "mana", 4 * S, 4 * S), (), None, "site")
    queries, search = SharedQueries(clock), CountingSearch(((result, Assessment()), ""))
    with queries.share(A):
        assert find(queries, A, search, 0, 100.0, soon())[1] == ""
        clock.set_ns(60 * S)
        reevaluated, reason = find(queries, A, search, 0, 100.0, soon())
    assert search.count == 1
    assert reevaluated is not None
    assert not reevaluated[1].acceptable
    assert "age" in reason


def test_an_unavailable_dpm_is_queried_once_for_all_requests() -> None:
    queries, search = SharedQueries(ManualClock(0)), CountingSearch(UnavailableError("away"))
    with queries.share(A):
        for _ in range(3):
            with pytest.raises(UnavailableError, match="away"):
                find(queries, A, search, 0, 100.0, soon())
    assert search.count == 1


def test_a_query_that_missed_its_own_deadline_is_not_shared() -> None:
    queries, late_search, search = (
        SharedQueries(ManualClock(0)),
        CountingSearch(DeadlineError("late")),
        CountingSearch(),
    )
    with queries.share(A):
        with pytest.raises(DeadlineError):
            find(queries, A, late_search, 0, 100.0, soon())
        assert find(queries, A, search, 0, 100.0, soon()) == (None, "nothing")


def test_a_request_whose_deadline_ends_during_a_shared_query_is_refused() -> None:
    queries, has_started, may_end = SharedQueries(ManualClock(0)), threading.Event(), threading.Event()

    def slow() -> Result:
        has_started.set()
        may_end.wait(10)
        return None, "slow"

    with queries.share(A):
        thread = threading.Thread(target=find, args=(queries, A, slow, 0, 100.0, soon()))
        thread.start()
        assert has_started.wait(10)
        with pytest.raises(DeadlineError, match="equivalent"):
            find(queries, A, CountingSearch(), 0, 100.0, monotonic_s() + 0.05)
        may_end.set()
        thread.join(10)


def test_requests_that_wait_for_a_shared_query_receive_its_result() -> None:
    queries, search = SharedQueries(ManualClock(0)), CountingSearch()
    has_started, may_end = threading.Event(), threading.Event()

    def slow() -> Result:
        has_started.set()
        may_end.wait(10)
        return search()

    with queries.share(A):
        thread = threading.Thread(target=find, args=(queries, A, slow, 1, 100.0, soon()))
        thread.start()
        assert has_started.wait(10)
        waiting = [queries.find(A, search, 1, 100.0, soon()) for _ in range(3)]
        pauses = [next(steps) for steps in waiting]
        may_end.set()
        for pause in pauses:
            assert pause.signal.wait(10)
        for steps in waiting:
            with pytest.raises(StopIteration) as end:
                next(steps)
            assert end.value.value == (None, "nothing")
        thread.join(10)
    assert search.count == 1


def test_different_requests_do_not_share_a_query() -> None:
    base = {"type": "dem", "region": "circle:0,0,5"}
    first_key = query_key(parse_request(base, "mana"))
    assert query_key(parse_request({**base, "format": "tif", "deadline_ms": "1000"}, "mana")) == first_key
    for other in (
        {"resolution_m": "0.1"},
        {"region": "circle:0,0,6"},
        {"max_age_s": "3"},
        {"min_coverage": "0.5"},
    ):
        assert query_key(parse_request({**base, **other}, "mana")) != first_key
    assert query_key(parse_request(base, "minnie")) != first_key
    pose_keys = [
        query_key(parse_request({"type": "pose", "frame": f}, "mana")) for f in ("site", "mana/odom")
    ]
    assert pose_keys[0] != pose_keys[1]


def test_the_end_of_a_query_wakes_each_waiting_request_once() -> None:
    queries, search = SharedQueries(ManualClock(0)), CountingSearch()
    with queries.share(A):
        others = [queries.find(A, search, 1, 100.0, soon()) for _ in range(20)]
        pauses: list[Any] = []

        def execute() -> Result:
            pauses.extend(next(steps) for steps in others)
            return None, "found"

        running = queries.find(A, execute, 1, 100.0, soon())
        with pytest.raises(StopIteration):
            next(running)
        assert all(pause.signal.is_set() for pause in pauses)
        for steps in others:
            with pytest.raises(StopIteration) as end:  # no second pause
                next(steps)
            assert end.value.value == (None, "found")
    assert search.count == 0

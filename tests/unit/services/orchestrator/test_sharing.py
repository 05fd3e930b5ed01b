# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Identical requests look together."""

from __future__ import annotations

import threading
from dataclasses import replace

import pytest

from cdff_common.clock import ManualClock, monotonic_s
from cdff_common.errors import DeadlineError, UnavailableError
from cdff_core.orchestration.judge import Candidate, Judgement
from cdff_core.orchestration.request import ProductRequest, parse_request
from services.orchestrator.finder import Found
from services.orchestrator.sharing import Result, SharedLooks, wish

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
def test_requests_that_wish_the_same_ask_once_until_something_is_inserted() -> None:
    looks, asked = SharedLooks(ManualClock(0)), Asked()
    b = replace(A, id="b", deadline_s=2.0, priority=9, format="tum", deliver="reference")
    with looks.joined(A), looks.joined(b):
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


def test_what_another_one_found_is_judged_by_the_clock_of_now() -> None:
    clock = ManualClock(5 * S)
    found = Found(Candidate("id", "mana", 4 * S, 4 * S), (), None, "site")
    looks, asked = SharedLooks(clock), Asked(((found, Judgement()), ""))
    with looks.joined(A):
        assert looks.find(A, asked, 0, 100.0, soon())[1] == ""
        clock.set_ns(60 * S)
        again, why = looks.find(A, asked, 0, 100.0, soon())
    assert asked.times == 1
    assert again is not None
    assert not again[1].acceptable
    assert "age" in why


def test_a_dpm_that_is_away_is_asked_once_for_all() -> None:
    looks, asked = SharedLooks(ManualClock(0)), Asked(UnavailableError("away"))
    with looks.joined(A):
        for _ in range(3):
            with pytest.raises(UnavailableError, match="away"):
                looks.find(A, asked, 0, 100.0, soon())
    assert asked.times == 1


def test_a_look_that_ran_out_of_its_own_time_is_nobody_else_s_answer() -> None:
    looks, late, asked = SharedLooks(ManualClock(0)), Asked(DeadlineError("late")), Asked()
    with looks.joined(A):
        with pytest.raises(DeadlineError):
            looks.find(A, late, 0, 100.0, soon())
        assert looks.find(A, asked, 0, 100.0, soon()) == (None, "nothing")


def test_who_has_no_time_to_wait_for_another_s_look_is_told_so() -> None:
    looks, inside, leave = SharedLooks(ManualClock(0)), threading.Event(), threading.Event()

    def slow() -> Result:
        inside.set()
        leave.wait(10)
        return None, "slow"

    with looks.joined(A):
        thread = threading.Thread(target=looks.find, args=(A, slow, 0, 100.0, soon()))
        thread.start()
        assert inside.wait(10)
        with pytest.raises(DeadlineError, match="identical"):
            looks.find(A, Asked(), 0, 100.0, monotonic_s() + 0.05)
        leave.set()
        thread.join(10)


def test_requests_that_differ_in_what_decides_the_product_do_not_share() -> None:
    base = {"type": "dem", "region": "circle:0,0,5"}
    one = wish(parse_request(base, "mana"))
    assert wish(parse_request({**base, "format": "tif", "deadline_ms": "1000"}, "mana")) == one
    for more in ({"resolution_m": "0.1"}, {"region": "circle:0,0,6"}, {"max_age_s": "3"}, {"min_coverage": "0.5"}):
        assert wish(parse_request({**base, **more}, "mana")) != one
    assert wish(parse_request(base, "minnie")) != one
    poses = [wish(parse_request({"type": "pose", "frame": f}, "mana")) for f in ("site", "mana/odom")]
    assert poses[0] != poses[1]

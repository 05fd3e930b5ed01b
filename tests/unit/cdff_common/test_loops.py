# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Loops survive errors, and report their end and their stalls."""

from __future__ import annotations

import pytest

from cdff_common.loops import Loops


def test_a_loop_survives_and_counts_every_error() -> None:
    loops = Loops()
    loop, items, results = loops.add("watcher"), iter([1, 0, 2, None]), []
    loop.run(lambda: next(items), lambda x: results.append(1 / x))
    assert results == [1.0, 0.5]
    assert loops.describe()["watcher"] == {
        "healthy": True,
        "problem": "",
        "errors": 1,
        "last_error": "ZeroDivisionError: division by zero",
    }


def test_a_loop_that_ends_by_itself_is_a_problem() -> None:
    loops = Loops()
    loop, items = loops.add("watcher"), iter([1])
    with pytest.raises(StopIteration):
        loop.run(lambda: next(items), lambda _: None)
    assert loops.problem() == "loop watcher has ended"


def test_a_loop_that_is_busy_for_too_long_is_a_problem_until_it_continues() -> None:
    now_s = 0.0
    loops = Loops(lambda: now_s)
    loop, items = loops.add("control", busy_limit_s=60.0), iter([1, None])

    def work(_: int) -> None:
        nonlocal now_s
        now_s = 61.0
        assert "busy for 61 s" in loops.problem()

    loop.run(lambda: next(items), work)
    assert loops.problem() == ""


def test_parallel_work_is_a_problem_while_its_oldest_piece_takes_too_long() -> None:
    now_s = 0.0
    loops = Loops(lambda: now_s)
    calls = loops.add_parallel("call stat", busy_limit_s=60.0)
    assert loops.problem() == ""
    with calls.piece():
        now_s = 50.0
        with calls.piece():
            now_s = 61.0
            assert loops.problem() == "call stat is busy for 61 s; expected at most 60 s"
    assert loops.problem() == ""
    assert loops.describe() == {}, "only loops are listed"


def test_a_piece_that_raises_ends() -> None:
    now_s = 0.0
    loops = Loops(lambda: now_s)
    with pytest.raises(ValueError), loops.add_parallel("call", 1.0).piece():
        raise ValueError
    now_s = 10.0
    assert loops.problem() == ""

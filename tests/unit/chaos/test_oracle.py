# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The oracle of the chaos suite notices each kind of broken promise."""

from __future__ import annotations

import pytest

from tests.chaos.oracle import QUEUED_S, Oracle, Stored


class Time:
    """Seconds that pass when they are read, or on command."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        self.now_s += 0.001
        return self.now_s


@pytest.fixture
def time() -> Time:
    return Time()


@pytest.fixture
def oracle(time: Time) -> Oracle:
    return Oracle(time)


def stored(name: str, t1_ns: int = 1) -> Stored:
    """Return a product in the DPM."""
    return Stored(name, "mana", "writer", "pose", t1_ns)


def test_a_run_that_kept_its_promises_has_no_violations(oracle: Oracle) -> None:
    oracle.acknowledge("a")
    oracle.publish("b", "mana")
    oracle.end_request(oracle.begin_request("pose", 2.0), "result")
    oracle.expect_alarm("disk_full", "dpm", lambda: True, 1.0)
    oracle.check_products([stored("a", 1), stored("b", 2), stored("not promised", 3)])
    oracle.check_requests()
    oracle.check_memory({"dpm": 100.0}, {"dpm": 150.0})
    assert oracle.violations == []
    assert oracle.summary()["alarms"]["disk_full"]["seen"] == 1


def test_a_lost_product_is_a_violation(oracle: Oracle) -> None:
    oracle.acknowledge("a")
    oracle.publish("b", "mana")
    oracle.check_products([])
    assert oracle.violations == [
        "product a: acknowledged and lost",
        "product b: queued in an outbox and lost",
    ]


def test_a_product_that_was_published_just_before_its_host_was_stopped_is_not_promised(
    oracle: Oracle, time: Time
) -> None:
    oracle.publish("queued", "mana")
    time.now_s += 2 * QUEUED_S
    oracle.publish("interrupted", "mana")
    oracle.publish("of another host", "minnie")
    oracle.interrupt("mana")
    assert oracle.promised() == {"queued", "of another host"}


def test_a_duplicated_product_is_a_violation(oracle: Oracle) -> None:
    oracle.check_products([stored("a"), stored("b")])  # the same capture under two ids
    assert len(oracle.violations) == 1
    assert "stored 2 times" in oracle.violations[0]


def test_a_request_without_an_answer_is_a_violation(oracle: Oracle) -> None:
    oracle.begin_request("pose of mana", 2.0)
    oracle.check_requests()
    assert oracle.violations == ["request pose of mana: no answer within 2 s"]


def test_an_answer_long_after_the_deadline_is_a_violation(oracle: Oracle, time: Time) -> None:
    request = oracle.begin_request("pose of mana", 2.0)
    time.now_s += 20.0
    oracle.end_request(request, "DeadlineError")
    assert "after its deadline" in oracle.violations[0]


def test_a_missed_alarm_is_a_violation(oracle: Oracle) -> None:
    oracle.expect_alarm("disk_full", "dpm", lambda: False, 0.0)
    assert oracle.violations == ["alarm disk_full of dpm: missed for 0 s"]


def test_memory_beyond_the_limit_is_a_violation(oracle: Oracle) -> None:
    oracle.check_memory(
        {"dpm": 300.0, "icu": 100.0, "router": 50.0}, {"dpm": 490.0, "icu": 161.0, "router": 60.0}
    )
    assert oracle.violations == ["memory of icu: 161 MB, expected at most 160 MB"]

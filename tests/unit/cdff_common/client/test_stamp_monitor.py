# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stamps are checked against the previous one and mission time."""

from __future__ import annotations

import pytest

from cdff_common.client.stamp_monitor import ClockLimits, StampMonitor
from cdff_common.errors import InputError

S = 1_000_000_000


def code(monitor: StampMonitor, stamp_ns: int, now_ns: int, jumped_s: float = 0.0) -> str:
    fault = monitor.fault(stamp_ns, now_ns, jumped_s)
    return "" if fault is None else fault.code


def test_stamps_in_order_near_mission_time_have_no_fault() -> None:
    monitor = StampMonitor()
    assert [code(monitor, t * S, t * S + S // 10) for t in range(1, 5)] == [""] * 4


def test_a_stamp_before_the_previous_one_is_named_with_the_difference() -> None:
    monitor = StampMonitor()
    monitor.fault(10 * S, 10 * S)
    fault = monitor.fault(8 * S, 10 * S)
    assert fault is not None
    assert fault.reason == "stamp_backwards:-2.000s"
    assert "2.000 s before the previous one" in str(fault)
    assert code(monitor, 10 * S, 10 * S) == "stamp_repeated"
    assert code(monitor, 11 * S, 11 * S) == ""


def test_a_single_stamp_far_ahead_does_not_refuse_those_that_follow() -> None:
    monitor = StampMonitor()
    assert code(monitor, 1 * S, 1 * S) == ""
    fault = monitor.fault(102 * S, 2 * S)
    assert fault is not None
    assert str(fault).startswith("the stamp is 100.000 s after mission time: synchronise")
    assert code(monitor, 3 * S, 3 * S) == ""


def test_the_limits_are_inclusive() -> None:
    limits = ClockLimits(ahead_s=0.5, delay_s=2.0)
    assert code(StampMonitor(limits), 10 * S + S // 2, 10 * S) == ""
    assert code(StampMonitor(limits), 10 * S + S // 2 + 1000, 10 * S) == "stamp_ahead"
    assert code(StampMonitor(limits), 8 * S, 10 * S) == ""
    assert code(StampMonitor(limits), 8 * S - 1000, 10 * S) == "stamp_late"


def test_after_a_jump_of_the_mission_clock_earlier_stamps_are_accepted() -> None:
    monitor = StampMonitor()
    assert code(monitor, 1000 * S, 1000 * S) == ""
    assert code(monitor, 100 * S, 100 * S, jumped_s=-900.0) == ""
    assert code(monitor, 99 * S, 100 * S, jumped_s=-900.0) == "stamp_backwards"


def test_limits_without_meaning_are_refused() -> None:
    with pytest.raises(InputError, match="delay_s above 0"):
        ClockLimits(delay_s=0.0)

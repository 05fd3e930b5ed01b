# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The mission clock is extrapolated when it is lost, and wrong ticks do not change it."""

from __future__ import annotations

import math
from typing import Any

import pytest

from cdff_common import clock, mission_clock
from cdff_common.clock import NS_PER_S
from cdff_common.errors import InputError
from cdff_common.mission_clock import ClockState, MissionClock

START_NS = 1_700_000_000 * NS_PER_S


class Monotonic:
    """Monotonic clock that a test advances."""

    now_s = 100.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def monotonic(monkeypatch: pytest.MonkeyPatch) -> Monotonic:
    monotonic = Monotonic()
    monkeypatch.setattr(mission_clock, "monotonic_s", monotonic)
    return monotonic


def test_without_a_publisher_mission_time_is_the_wall_clock() -> None:
    mission = MissionClock()
    assert abs(mission.now_ns() - clock.wall_ns()) < NS_PER_S
    assert mission.state is ClockState.WALL


def test_a_lost_clock_is_extrapolated_and_reported(
    monotonic: Monotonic, caplog: pytest.LogCaptureFixture
) -> None:
    mission = MissionClock(timeout_s=2.0)
    mission.on_tick(START_NS, 2.0)
    monotonic.now_s += 0.5
    assert (mission.now_ns(), mission.state) == (START_NS + NS_PER_S, ClockState.RUNNING)
    assert "clock lost" not in caplog.text
    monotonic.now_s += 3600.0
    assert (mission.now_ns(), mission.state) == (START_NS + 7201 * NS_PER_S, ClockState.LOST)
    assert "clock lost" in caplog.text
    mission.on_tick(START_NS + 7201 * NS_PER_S, 1.0)
    assert mission.state is ClockState.RUNNING


@pytest.mark.parametrize(
    ("now_ns", "rate"),
    [
        (START_NS, math.inf),
        (START_NS, math.nan),
        (START_NS, -1.0),
        (START_NS, 1001.0),
        (1 << 62, 1.0),
        (-1, 1.0),
        (float(START_NS), 1.0),
        (math.inf, 1.0),
        (START_NS, "1"),
        (START_NS, None),
        (True, 1.0),
    ],
)
def test_a_tick_out_of_range_is_refused_and_changes_nothing(
    monotonic: Monotonic, now_ns: Any, rate: Any
) -> None:
    mission = MissionClock()
    with pytest.raises(InputError, match="mission clock"):
        mission.on_tick(now_ns, rate)
    assert mission.state is ClockState.WALL
    mission.on_tick(START_NS, 1.0)
    with pytest.raises(InputError, match="mission clock"):
        mission.on_tick(now_ns, rate)
    assert mission.now_ns() == START_NS


def test_one_tick_with_a_jump_is_refused_and_a_confirmed_jump_is_accepted(monotonic: Monotonic) -> None:
    mission = MissionClock()
    mission.on_tick(START_NS, 1.0)
    later_ns = START_NS + 86_400 * NS_PER_S
    with pytest.raises(InputError, match="a jump of 86400 s"):
        mission.on_tick(later_ns, 1.0)
    monotonic.now_s += 0.5
    mission.on_tick(START_NS + NS_PER_S // 2, 1.0)
    assert mission.now_ns() == START_NS + NS_PER_S // 2
    for i in range(20):
        monotonic.now_s += 0.1
        with pytest.raises(InputError):
            mission.on_tick(later_ns + i * NS_PER_S // 10, 1.0)
    monotonic.now_s += 0.2
    mission.on_tick(later_ns + 21 * NS_PER_S // 10, 1.0)
    assert mission.now_ns() == later_ns + 21 * NS_PER_S // 10
    assert mission.jumped_s == pytest.approx(86_400.0, abs=3.0)


def test_ticks_that_jump_to_and_fro_are_never_accepted(monotonic: Monotonic) -> None:
    mission = MissionClock()
    mission.on_tick(START_NS, 1.0)
    for i in range(100):
        monotonic.now_s += 0.1
        with pytest.raises(InputError):
            mission.on_tick(START_NS + (1 + i % 2) * 86_400 * NS_PER_S, 1.0)
    assert mission.now_ns() == pytest.approx(START_NS + 10 * NS_PER_S, abs=10_000)


def test_a_clock_at_a_high_rate_may_be_late(monotonic: Monotonic) -> None:
    mission = MissionClock()
    mission.on_tick(START_NS, 1000.0)
    monotonic.now_s += 1.0
    mission.on_tick(START_NS + 100 * NS_PER_S, 1000.0)
    assert mission.now_ns() == START_NS + 100 * NS_PER_S

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Nothing is retired while the mission clock is lost or after it has jumped; products wait for it."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path

import pytest

from cdff_common import mission_clock
from cdff_common.clock import NS_PER_S, wall_ns
from cdff_common.errors import ClockSkewError, InputError, UnavailableError, rpc_code
from cdff_common.mission_clock import MissionClock
from dpm_store import Rule, open_store
from services.dpm.operations import clock_guard
from services.dpm.operations.dpm import Dpm

from .conftest import cloud, put_arguments

DAY_NS = 86_400 * NS_PER_S
Start = Callable[[MissionClock], AbstractContextManager[Dpm]]
RULES = (Rule(product="pointcloud", max_age_s=3600.0),)


class Time:
    """Monotonic clock and wall clock that a test advances together."""

    def __init__(self) -> None:
        self.start_ns, self.now_s = wall_ns(), 0.0

    def monotonic_s(self) -> float:
        return self.now_s

    def wall_ns(self) -> int:
        return self.start_ns + int(self.now_s * NS_PER_S)


@pytest.fixture
def time(monkeypatch: pytest.MonkeyPatch) -> Time:
    time = Time()
    for module in (mission_clock, clock_guard):
        monkeypatch.setattr(module, "monotonic_s", time.monotonic_s)
        monkeypatch.setattr(module, "wall_ns", time.wall_ns)
    return time


@pytest.fixture
def start(empty_store: Path, tmp_path: Path) -> Start:
    shutil.copytree(empty_store, tmp_path / "data")

    @contextmanager
    def running(clock: MissionClock) -> Iterator[Dpm]:
        with open_store(f"sqlite:///{tmp_path}/data", clock) as store:
            yield Dpm(store)

    return running


def put(dpm: Dpm, count: int) -> None:
    now_ns = dpm.clock.now_ns()
    for i in range(count):
        dpm.writer.put(*put_arguments(cloud(), "pointcloud", i, t1_ns=now_ns + i * 1000))


def tick(clock: MissionClock, now_ns: int, time: Time, seconds: float = 3.0) -> None:
    """Publish ticks for some seconds."""
    for i in range(int(seconds * 10) + 1):
        with suppress(InputError):
            clock.on_tick(now_ns + i * NS_PER_S // 10, 1.0)
        time.now_s += 0.1


def test_when_the_publisher_ends_nothing_is_retired_and_an_alarm_says_so(start: Start, time: Time) -> None:
    clock = MissionClock()
    mission_ns = time.wall_ns() - 30 * DAY_NS
    tick(clock, mission_ns, time)
    with start(clock) as dpm:
        put(dpm, 5)
        assert dpm.writer.retire(RULES, apply=True).to_delete == 0
        time.now_s += 7200.0  # the publisher has ended
        with pytest.raises(UnavailableError, match="clock is lost"):
            dpm.writer.retire(RULES, apply=True)
        assert [alarm.kind for alarm in dpm.alarms.active()] == ["clock"]
        assert dpm.writer.retire(RULES).to_delete == 5  # the plan is shown
        assert dpm.store.statistics().count == 5
        tick(clock, mission_ns + 100 * NS_PER_S, time)  # back, within the bound of the guard
        assert dpm.writer.retire(RULES, apply=True).to_delete == 0
        assert dpm.alarms.active() == []


def test_after_a_restart_without_the_clock_nothing_is_retired_until_it_is_confirmed(
    start: Start, time: Time
) -> None:
    clock = MissionClock()
    tick(clock, time.wall_ns() - 30 * DAY_NS, time)
    with start(clock) as dpm:
        put(dpm, 5)
        dpm.writer.clock_guard.update()
    with start(MissionClock()) as dpm:
        with pytest.raises(UnavailableError, match="clock is lost"):
            dpm.writer.retire(RULES, apply=True)
        assert dpm.store.statistics().count == 5
        dpm.writer.clock_guard.confirm()
        assert dpm.writer.retire(RULES, apply=True).to_delete == 5


def test_a_clock_that_jumps_forward_retires_nothing_until_an_operator_confirms_it(
    start: Start, time: Time
) -> None:
    clock = MissionClock()
    tick(clock, time.wall_ns(), time)
    with start(clock) as dpm:
        put(dpm, 5)
        dpm.writer.clock_guard.update()
        tick(clock, time.wall_ns() + 30 * DAY_NS, time)
        with pytest.raises(UnavailableError, match="jumped by 2592"):
            dpm.writer.retire(RULES, apply=True)
        tick(clock, time.wall_ns(), time)  # the clock is set right: no operator is needed
        assert dpm.writer.retire(RULES, apply=True).to_delete == 0


def test_a_clock_that_jumped_while_the_dpm_was_stopped_is_noticed(start: Start, time: Time) -> None:
    first, second = MissionClock(), MissionClock()
    tick(first, time.wall_ns(), time)
    with start(first) as dpm:
        put(dpm, 5)
        dpm.writer.clock_guard.update()
    time.now_s += 1800.0
    tick(second, time.wall_ns() + 30 * DAY_NS, time)
    with start(second) as dpm, pytest.raises(UnavailableError, match="jumped by 2592"):
        dpm.writer.retire(RULES, apply=True)


@pytest.mark.parametrize(("jump_s", "is_accepted"), [(-86_400.0, True), (3599.5, True), (3600.5, False)])
def test_a_jump_by_up_to_an_hour_while_the_dpm_was_stopped_is_accepted(
    start: Start, time: Time, jump_s: float, is_accepted: bool
) -> None:
    first, second = MissionClock(), MissionClock()
    tick(first, time.wall_ns(), time)
    with start(first) as dpm:
        put(dpm, 1)
        dpm.writer.clock_guard.update()
    time.now_s += 1800.0
    tick(second, time.wall_ns() + int(jump_s * NS_PER_S), time)
    with start(second) as dpm:
        reason = dpm.writer.clock_guard.update()
    assert ("mission time jumped" in reason) == (not is_accepted)


def test_a_stop_of_a_mission_on_the_wall_clock_is_no_jump(start: Start, time: Time) -> None:
    with start(MissionClock()) as dpm:
        put(dpm, 5)
        dpm.writer.clock_guard.update()
    time.now_s += 7 * 86_400.0
    with start(MissionClock()) as dpm:
        assert dpm.writer.retire(RULES, apply=True).to_delete == 5


def test_a_product_ahead_of_the_clock_is_retriable_and_reported(start: Start, time: Time) -> None:
    with start(MissionClock()) as dpm:
        arguments = put_arguments(
            cloud(), "pointcloud", t1_ns=time.wall_ns() // 1000 * 1000 + 3600 * NS_PER_S
        )
        with pytest.raises(ClockSkewError) as caught:
            dpm.writer.put(*arguments)
        assert rpc_code(caught.value) == ("UNAVAILABLE", True)
        assert dpm.events.counters["skewed"] == 1
        (alarm,) = dpm.alarms.active()
        assert (alarm.kind, alarm.source) == ("clock_skew", "mana")
        time.now_s += 3600.0  # the clock of the DPM is right again
        dpm.writer.put(*arguments)
        assert dpm.alarms.active() == []

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tokens, heartbeats and events on the bus become the state of the system."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from types import SimpleNamespace
from typing import Any

import pytest

from cdff_common.bus import keys
from cdff_common.errors import UnavailableError
from cdff_common.loops import Loops
from cdff_core.orchestration.reconciliation import Configuration
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.system_monitor import SystemMonitor
from services.orchestrator.timing import Timing

VO = ProviderId("mana", "visual_odometry_sparse")
LIDAR = SensorId("mana", "lidar")


class State:
    """Calls that the monitor makes, by name."""

    def __init__(self) -> None:
        self.calls: list[tuple[Any, ...]] = []

    def has_provider(self, provider: ProviderId) -> bool:
        return provider == VO

    def __getattr__(self, name: str) -> Callable[..., None]:
        return lambda *values, **named: self.calls.append((name, *values, *named.values()))


class Answers:
    """Bus that answers calls by key."""

    def __init__(self) -> None:
        self.answers: dict[str, Any] = {}
        self.called: list[str] = []

    def call(self, key: str, timeout_s: float) -> Any:
        self.called.append(key)
        if key not in self.answers:
            raise UnavailableError(f"{key}: no answer")
        return SimpleNamespace(body=lambda: self.answers[key])


class Work(Timing):
    """Timing whose queue runs each task at once, as the thread would."""

    def queue(self) -> Any:
        def put(task: Callable[[], None] | None) -> None:
            if task is not None:
                with suppress(UnavailableError):
                    task()

        return SimpleNamespace(put=put)


@pytest.fixture
def state() -> State:
    return State()


@pytest.fixture
def bus() -> Answers:
    return Answers()


@pytest.fixture
def monitor(bus: Answers, state: State) -> SystemMonitor:
    return SystemMonitor(bus, state, Loops(), Work())  # type: ignore[arg-type]


@pytest.fixture
def description(bus: Answers, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Description of the DFPC on the bus, which is valid."""
    monkeypatch.setattr("services.orchestrator.system_monitor.provider_of", lambda *_, **__: None)
    described = {"state": "inactive"}
    bus.answers[keys.dfpc_rpc(*VO, "describe")] = described
    return described


def test_a_new_dfpc_is_described_once_and_alive_until_its_token_is_gone(
    monitor: SystemMonitor, bus: Answers, state: State, description: dict[str, Any]
) -> None:
    monitor._on_alive(keys.alive(*VO), True)
    monitor._on_alive(keys.alive(*VO), True)
    assert bus.called == [keys.dfpc_rpc(*VO, "describe")]
    assert state.calls == [
        ("set_description", VO, description),
        ("set_state", VO, "inactive"),
        ("set_alive", VO, True),
    ]
    monitor._on_alive(keys.alive(*VO), False)
    assert state.calls[3:] == [("set_alive", VO, False)]
    monitor._on_alive(keys.alive(*VO), True)
    assert len(bus.called) == 2


def test_a_heartbeat_repeats_a_failed_description(
    monitor: SystemMonitor, bus: Answers, state: State, description: dict[str, Any]
) -> None:
    answer = bus.answers.pop(keys.dfpc_rpc(*VO, "describe"))
    monitor._on_alive(keys.alive(*VO), True)
    assert state.calls == []
    bus.answers[keys.dfpc_rpc(*VO, "describe")] = answer
    heartbeat = {"state": "active", "last_error": "e", "wired": {"stereo": 1}, "changes": 3}
    heartbeat |= {"implementation": "KeyframeKlt", "adjusted": {"b": 2, "a": 1}}
    monitor._on_status(keys.dfpc_status(*VO), heartbeat)
    assert state.calls[0] == ("set_description", VO, description)
    assert state.calls[-2:] == [
        (
            *("set_state", VO, "active", "e", {"stereo": 1}, 3),
            Configuration("KeyframeKlt", (("a", 1.0), ("b", 2.0))),
        ),
        ("add_status", VO, heartbeat),
    ]
    monitor._on_status(keys.dfpc_status(*VO), {"state": "active", "wired": [], "changes": "3"})
    assert state.calls[-2] == ("set_state", VO, "active", "", None, None, None)


def test_heartbeats_without_a_token_or_state_are_ignored(
    monitor: SystemMonitor, state: State, description: dict[str, Any]
) -> None:
    monitor._on_status(keys.dfpc_status(*VO), {"state": "active"})
    assert state.calls == []
    monitor._on_alive(keys.alive(*VO), True)
    before = len(state.calls)
    monitor._on_status(keys.dfpc_status(*VO), {})
    assert len(state.calls) == before


def test_only_the_control_unit_of_a_robot_that_appears_is_asked_for_modes(
    monitor: SystemMonitor, bus: Answers, state: State
) -> None:
    bus.answers[keys.icu_rpc("mana", "modes")] = {
        "sensors": {"lidar": {"mode": "fast", "robot": "mana", "sensor": "lidar"}}
    }
    for key, alive in (
        (keys.alive(keys.GROUND, "icu"), True),
        (keys.alive("mana", "icu"), False),
        (keys.alive("mana", "dpm"), True),
    ):
        monitor._on_alive(key, alive)
    assert bus.called == []
    monitor._on_alive(keys.alive("mana", "icu"), True)
    assert bus.called == [keys.icu_rpc("mana", "modes")]
    assert state.calls == [("set_mode", LIDAR, "fast", "")]


def test_an_alarm_that_a_known_dfpc_is_in_error_sets_its_state(monitor: SystemMonitor, state: State) -> None:
    key = keys.event("mana", "alarm")
    for body in ({"dfpc": "unknown", "state": "error"}, {"dfpc": VO.dfpc, "state": "ok"}, {}):
        monitor._on_alarm(key, body)
    assert state.calls == []
    monitor._on_alarm(key, {"dfpc": VO.dfpc, "state": "error", "reason": "no images"})
    assert state.calls == [("set_state", VO, "error", "no images")]


@pytest.mark.parametrize(
    ("event", "lost"),
    [
        ({"mode": "off", "state": "ok", "reason": "x"}, ""),
        ({"mode": "off", "state": "lost", "reason": "cable"}, "cable"),
        ({"mode": "off", "state": "lost"}, "reported by the instrument control unit"),
    ],
)
def test_a_lost_sensor_has_a_reason(
    monitor: SystemMonitor, state: State, event: dict[str, Any], lost: str
) -> None:
    monitor._on_mode(keys.event("mana", "sensor_mode"), {"sensor": "lidar", **event})
    assert state.calls == [("set_mode", LIDAR, "off", lost)]


def test_an_insertion_is_counted_for_its_kind_of_product(monitor: SystemMonitor, state: State) -> None:
    monitor._on_inserted(keys.event("mana", "inserted"), {"product": "dem"})
    assert state.calls == [("add_insertion", "mana", "dem")]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Observed state of DFPCs and sensors: reports out of order, ownership, refused modes, change signals."""

from __future__ import annotations

import itertools
import threading
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cdff_common.interfaces.profile import load_profile
from cdff_core.orchestration.acquisition import Acquisition, AcquisitionParameters
from cdff_core.orchestration.planner import Plan, plan
from cdff_core.orchestration.reconciliation import Deactivate, SetMode
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.state import HEALTHY_S, REFUSAL_S, SystemState
from services.orchestrator.timing import Timing
from services.orchestrator.worlds import Worlds

PROFILE = load_profile(Path(__file__).parents[4] / "deploy" / "profiles" / "rover_traverse.yaml")
DEM, VO = ProviderId("mana", "digital_elevation_mapping"), ProviderId("mana", "visual_odometry_sparse")
NAVCAM, LIDAR = SensorId("mana", "navcam"), SensorId("mana", "lidar")


class SetTime(Timing):
    """Time set by tests."""

    def __init__(self) -> None:
        self.time_s = 100.0

    def now_s(self) -> float:
        return self.time_s


@pytest.fixture
def timing() -> SetTime:
    return SetTime()


@pytest.fixture
def state(timing: SetTime) -> SystemState:
    return SystemState(PROFILE, timing)


def entry_of(state: SystemState, provider: ProviderId) -> dict[str, Any]:
    """Return the entry of a provider of mana in the catalogue."""
    entries = state.catalogue([provider.robot], "dem")["dfpcs"]
    (entry,) = (e for e in entries if e["name"] == provider.dfpc)
    return dict(entry)


def failures_of(state: SystemState, provider: ProviderId) -> tuple[int, str]:
    entry = entry_of(state, provider)
    return entry["failures"], entry["last_failure"]


def deactivated(state: SystemState) -> set[ProviderId]:
    return {action.provider for action in state.actions()[0] if isinstance(action, Deactivate)}


def demanded(state: SystemState) -> dict[SensorId, str]:
    """Return the modes demanded of the sensors of mana."""
    actions = (action for action in state.actions()[0] if isinstance(action, SetMode))
    return {action.sensor: action.mode for action in actions if action.sensor.robot == "mana"}


def test_a_report_older_than_the_last_one_is_ignored(state: SystemState) -> None:
    state.set_alive(DEM, True)
    state.set_state(DEM, "active", changes=5)
    version = state.version
    state.set_state(DEM, "error", "late", changes=4)
    assert state.version == version
    state.set_owned(DEM, True)
    assert deactivated(state) == {DEM}
    state.set_state(DEM, "inactive", changes=5)
    assert state.version == version + 1
    assert deactivated(state) == set()
    # A new process counts its changes from the start.
    state.set_alive(DEM, False)
    state.set_alive(DEM, True)
    state.set_state(DEM, "active", changes=1)
    assert deactivated(state) == {DEM}


def test_only_owned_providers_are_deactivated(state: SystemState) -> None:
    state.set_alive(DEM, True)
    state.set_state(DEM, "active")
    assert deactivated(state) == set()
    state.set_owned(DEM, True)
    assert deactivated(state) == {DEM}
    state.set_owned(DEM, False)
    assert deactivated(state) == set()


def test_providers_of_an_earlier_process_are_owned_and_linger(state: SystemState, timing: SetTime) -> None:
    state.set_alive(DEM, True)
    state.set_state(DEM, "active")
    state.recover([DEM], [LIDAR, SensorId("mana", "unknown")])
    assert deactivated(state) == set()
    _, next_s = state.actions()
    assert next_s is not None
    timing.time_s = next_s + 0.1
    assert deactivated(state) == {DEM}


def test_a_signal_is_given_only_for_a_change(state: SystemState) -> None:
    versions = [state.version]
    for report in (
        lambda: state.set_mode(NAVCAM, "nominal"),
        lambda: state.set_mode(NAVCAM, "nominal"),
        lambda: state.set_mode(NAVCAM, "nominal", "no power"),
        lambda: state.set_mode(NAVCAM, "nominal", "no power"),
        lambda: state.set_mode(NAVCAM, "nominal"),
    ):
        report()
        versions.append(state.version)
    assert [b - a for a, b in itertools.pairwise(versions)] == [1, 0, 1, 0, 1]


def test_a_refused_mode_is_demanded_again_after_a_while(state: SystemState, timing: SetTime) -> None:
    state.set_mode(NAVCAM, "off")
    assert demanded(state) == {NAVCAM: "nominal"}
    state.add_mode_refusal(NAVCAM, "nominal", "too hot")
    assert demanded(state) == {}
    timing.time_s += REFUSAL_S - 0.1
    assert demanded(state) == {}
    timing.time_s += 0.2
    assert demanded(state) == {NAVCAM: "nominal"}


def test_a_changed_sensor_without_use_returns_to_its_initial_mode(state: SystemState) -> None:
    state.set_mode(LIDAR, "nominal")
    assert LIDAR not in demanded(state)
    state.add_mode_change(LIDAR)
    assert demanded(state)[LIDAR] == "off"


def test_a_failure_without_a_reason_is_the_reported_state_error(state: SystemState) -> None:
    state.set_alive(DEM, True)
    state.set_state(DEM, "active")
    state.set_state(DEM, "error")
    assert failures_of(state, DEM) == (1, "it reported state error")


def test_failures_are_cleared_by_a_healthy_time_in_state_active(state: SystemState, timing: SetTime) -> None:
    state.set_alive(DEM, True)
    state.set_state(DEM, "active")
    state.set_state(DEM, "error", "no memory")
    assert failures_of(state, DEM) == (1, "no memory")
    state.set_state(DEM, "error", "again")  # the same failure
    assert failures_of(state, DEM) == (1, "no memory")
    state.set_state(DEM, "active")
    timing.time_s += HEALTHY_S
    state.set_state(DEM, "active")
    assert failures_of(state, DEM)[0] == 1
    timing.time_s += 0.1
    state.set_state(DEM, "active")
    assert failures_of(state, DEM) == (0, "")


def test_a_vanished_process_is_neither_alive_nor_active(state: SystemState) -> None:
    state.set_alive(VO, True)
    state.set_state(VO, "active", wired={"stereo": "sensor/navcam/pair"})
    entry = entry_of(state, VO)
    assert (entry["alive"], entry["active"], entry["state"]) == (True, True, "active")
    assert entry["wired"] == {"stereo": "sensor/navcam/pair"}
    state.set_alive(VO, False)
    entry = entry_of(state, VO)
    assert (entry["alive"], entry["active"], entry["state"]) == (False, False, "unknown")
    assert entry["wired"] == {}


def test_insertions_are_counted_by_product(state: SystemState) -> None:
    for robot, product in (("mana", "dem"), ("mana", "pose"), ("minnie", "dem")):
        state.add_insertion(robot, product)
    assert state.insertions([("mana", "dem")]) == 1
    assert state.insertions([("any", "dem")]) == 2
    assert state.insertions([("any", "dem"), ("mana", "pose"), ("mana", "trajectory")]) == 3


def test_a_change_wakes_only_the_jobs_that_it_concerns(state: SystemState) -> None:
    events = {name: threading.Event() for name in ("mana", "minnie", "all")}

    def woken() -> set[str]:
        names = {name for name, event in events.items() if event.is_set()}
        for event in events.values():
            event.clear()
        return names

    with (
        state.watch(events["mana"], ["mana"], [("mana", "dem")]),
        state.watch(events["minnie"], ["minnie"], [("minnie", "dem")]),
        state.watch(events["all"], ["mana", "minnie"], [("any", "dem")]),
    ):
        state.set_alive(DEM, True)
        assert woken() == {"mana", "all"}
        state.add_insertion("minnie", "dem")
        assert woken() == {"minnie", "all"}
        state.add_insertion("mana", "pose")
        assert woken() == set()
        state.notify()
        assert woken() == {"mana", "minnie", "all"}
    state.notify()
    assert woken() == set()


def test_a_further_holder_of_the_same_plan_is_no_change(state: SystemState) -> None:
    for provider in (VO, DEM):
        state.set_alive(provider, True)
    selected = plan(state.world(optimistic=True), "dem", ["mana"])
    assert isinstance(selected, Plan)
    state.hold("first", selected, 5)
    version = state.version
    state.hold("second", selected, 5)
    state.release("first")
    assert state.version == version
    state.release("second")
    assert state.version == version + 1


def test_the_world_of_some_robots_is_the_part_of_the_whole(state: SystemState) -> None:
    state.set_alive(DEM, True)
    state.set_state(DEM, "active")
    whole, part = state.world(), state.world(robots=["mana"])
    assert part.providers == {p: x for p, x in whole.providers.items() if p.robot == "mana"}
    assert part.sensors == {s: x for s, x in whole.sensors.items() if s.robot == "mana"}
    assert set(part.free) <= {"mana"}
    assert part.reserved == {p for p in whole.reserved if p.robot == "mana"}


def test_equal_requests_share_a_world_until_a_change_of_their_robot(timing: SetTime) -> None:
    state = SystemState(PROFILE, timing)
    robots = ("mana",)
    world = state.world(robots=robots)
    assert state.world(robots=robots) is world
    assert state.world(robots=robots, priority=3) is not world
    state.notify("minnie")
    assert state.world(robots=robots) is world
    state.set_alive(DEM, alive=True)
    changed = state.world(robots=robots)
    assert changed is not world
    timing.time_s += Worlds.LONGEST_S + 0.1
    assert state.world(robots=robots) is not changed


def test_new_actions_are_those_of_changed_robots_and_of_times_that_have_come(
    timing: SetTime, state: SystemState
) -> None:
    mana, minnie = (ProviderId(robot, "digital_elevation_mapping") for robot in ("mana", "minnie"))
    for provider in (mana, minnie):
        state.set_alive(provider, alive=True)
        state.set_state(provider, "active")
        state.set_owned(provider, owned=True)

    def robots_of_new_actions() -> set[str]:
        actions, _ = state.new_actions()
        return {action.provider.robot for action in actions if isinstance(action, Deactivate)}

    assert robots_of_new_actions() == {"mana", "minnie"}
    assert robots_of_new_actions() == set()
    state.notify("minnie")
    assert robots_of_new_actions() == {"minnie"}
    state.add_failure(mana, "no answer")
    assert robots_of_new_actions() == set()  # it is repeated after a back-off
    timing.time_s = state.new_actions()[1] or 0.0
    assert robots_of_new_actions() == {"mana"}
    timing.time_s += 5.0
    assert robots_of_new_actions() == {"mana", "minnie"}
    assert {provider.robot for provider in deactivated(state)} == {"mana", "minnie"}


def test_a_new_acquisition_with_equal_leases_is_a_change(state: SystemState) -> None:
    acquisition = Acquisition("single", AcquisitionParameters.parse("now"))
    needs = Plan(DEM, "map", (DEM,), {SensorId("mana", "lidar"): "nominal"}, 1.0)
    state.hold("first", needs, 5)
    state.new_actions()
    before = state.version
    state.hold("second", replace(needs, acquisitions={SensorId("mana", "lidar"): acquisition}), 5)
    assert state.version > before
    assert state.is_acquisition_pending("second", SensorId("mana", "lidar"))


def test_an_error_keeps_the_changed_robots_for_the_next_call(
    state: SystemState, monkeypatch: pytest.MonkeyPatch
) -> None:
    state.set_alive(DEM, alive=True)
    state.set_state(DEM, "active")
    state.set_owned(DEM, owned=True)
    state.new_actions()
    state.notify("mana")
    with monkeypatch.context() as patched:
        patched.setattr(SystemState, "_actions", lambda *_: 1 / 0)
        with pytest.raises(ZeroDivisionError):
            state.new_actions()
    assert Deactivate(DEM) in state.new_actions()[0]

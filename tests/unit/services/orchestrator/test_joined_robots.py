# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""State of robots that join a running orchestrator, return with another profile, and leave."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import CdffError, UnavailableError
from cdff_common.interfaces.profile import load_profile
from cdff_common.interfaces.registry import Registry
from cdff_common.interfaces.robot_profile import RobotProfile
from cdff_common.resources import deploy_folder
from cdff_core.orchestration.planner import NoPlan, Plan, plan
from cdff_core.orchestration.reconciliation import Activate, Configure
from cdff_core.orchestration.world import ProviderId, SensorId
from services.orchestrator.state import SystemState
from tests.support import orchestrator_mission
from tests.support.orchestrator_stage import Stage

BOTH = load_profile(deploy_folder() / "profiles" / "two_rovers.yaml")
MANA, MINNIE = (RobotProfile.of(BOTH, robot) for robot in ("mana", "minnie"))
DFPCS = {entry.name for entry in MINNIE.robot.dfpcs}


def run_all(state: SystemState, robot: str = "minnie") -> None:
    for name in DFPCS:
        state.set_alive(ProviderId(robot, name), alive=True)


@pytest.fixture
def state() -> SystemState:
    return SystemState(MANA.profile)


def test_a_robot_that_joined_is_planned_like_one_of_the_profile(state: SystemState) -> None:
    assert isinstance(plan(state.world(), "pose", ["minnie"]), NoPlan)
    version = state.version
    state.set_robot(MINNIE)
    run_all(state)
    assert state.version > version
    assert state.robot_ids == ("mana", "minnie")
    assert isinstance(plan(state.world(), "pose", ["minnie"]), Plan)
    both = SystemState(BOTH)
    run_all(both)
    assert state.catalogue(["minnie"]) == both.catalogue(["minnie"])
    started = {a.provider for a in state.actions()[0] if isinstance(a, Configure | Activate)}
    assert started == {a.provider for a in both.actions()[0] if isinstance(a, Configure | Activate)}


def test_nothing_of_a_robot_that_left_is_planned_listed_or_acted_upon(state: SystemState) -> None:
    state.set_robot(MINNIE)
    run_all(state)
    made = plan(state.world(), "pose", ["minnie"])
    assert isinstance(made, Plan)
    state.hold("job", made, priority=5)
    state.remove_robot("minnie")
    assert state.robot_ids == ("mana",)
    for optimistic in (False, True):
        refused = plan(state.world(optimistic=optimistic), "pose", ["minnie"])
        assert isinstance(refused, NoPlan)
        assert "it has left with robot minnie" in refused.text
    listed = state.catalogue(["mana", "minnie"])
    assert {d["robot"] for d in listed["dfpcs"]} == {"mana"}
    assert {s["robot"] for s in listed["sensors"]} == {"mana"}
    assert {p["robot"] for p in listed["products"]} == {"mana"}
    assert all("minnie" not in str(action) for action in state.actions()[0])
    assert state.progress(made, "job").dead  # the open job sees that its providers are gone
    state.release("job")
    state.remove_robot("never_there")


def test_dfpcs_and_sensors_are_those_of_the_profile_with_which_a_robot_returns(state: SystemState) -> None:
    state.set_robot(MINNIE)
    run_all(state)
    first, *others = MINNIE.robot.dfpcs
    sensors = {n: s for n, s in MINNIE.robot.sensors.items() if n != "lidar"} | {
        "second_lidar": MINNIE.robot.sensors["lidar"]
    }
    less = MINNIE.robot.model_copy(update={"dfpcs": tuple(others), "sensors": sensors})
    state.set_robot(RobotProfile(MINNIE.profile.model_copy(update={"robots": (less,)})))
    listed = state.catalogue(["minnie"])
    assert {d["name"] for d in listed["dfpcs"]} == DFPCS - {first.name}
    assert not any(d["alive"] for d in listed["dfpcs"])  # until their processes are seen
    assert {s["sensor"] for s in listed["sensors"]} == set(sensors)
    assert not state.has_provider(ProviderId("minnie", first.name))
    state.set_mode(SensorId("minnie", "lidar"), "off")  # a late report of the earlier revision
    state.actions()
    state.set_robot(MINNIE)
    assert state.has_provider(ProviderId("minnie", first.name))


def test_a_robot_with_a_dfpc_that_is_not_installed_changes_nothing(state: SystemState) -> None:
    unknown = MINNIE.robot.dfpcs[0].model_copy(update={"name": "not_installed"})
    robot = MINNIE.robot.model_copy(update={"dfpcs": (unknown,)})
    with pytest.raises(CdffError, match="not_installed"):
        state.set_robot(RobotProfile(MINNIE.profile.model_copy(update={"robots": (robot,)})))
    assert state.robot_ids == ("mana",)


def test_a_robot_that_another_orchestrator_leads_does_not_join(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        Registry, "default", classmethod(lambda cls: orchestrator_mission.SimulatedRegistry())
    )
    profile = orchestrator_mission.profile()
    stage = Stage(tmp_path, RobotProfile.of(profile, "mana").profile)
    monkeypatch.setattr(stage.bus, "alive", lambda key: {key})
    monkeypatch.setattr(stage.bus, "has_token", lambda key: False, raising=False)
    with pytest.raises(UnavailableError, match="another orchestrator leads minnie"):
        stage.orchestrator.set_robot(RobotProfile.of(profile, "minnie"))
    assert stage.orchestrator._state.robot_ids == ("mana",)

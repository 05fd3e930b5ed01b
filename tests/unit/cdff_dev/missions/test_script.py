# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mission files: shipped ones are consistent with profile and scenario, invalid ones are refused by key."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_dev.missions.orbit.script import Ask, RestartProcess, is_orbital, load_orbit_mission
from cdff_dev.missions.orbit.script import check_fits as check_orbit_fits
from cdff_dev.missions.script import Follow, GoTo, Meet, check_fits, load_mission
from cdff_dev.simulate.orbit.scenario import OrbitScenario
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.scenario_files import load_any_scenario

MISSIONS = sorted((deploy_folder() / "missions").glob("*.yaml"))
SHIPPED = [path for path in MISSIONS if not is_orbital(path)]
ORBITAL = [path for path in MISSIONS if is_orbital(path)]
#: Missions, and their variants without a lidar.
VARIANTS = [(path, False) for path in SHIPPED] + [
    (path, True) for path in SHIPPED if "without_lidar:" in path.read_text(encoding="utf-8")
]
VALID = (
    "doc: A test.\nprofile: explorer\nscenario: outing\nrobots:\n  mana: [{do: go_to, xy_m: [1.0, 2.0]}]\n"
)


def write_mission(folder: Path, text: str) -> Path:
    path = folder / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.req("CDFF-DEV-073")
@pytest.mark.parametrize(("path", "without_lidar"), VARIANTS, ids=lambda v: getattr(v, "stem", str(v)))
def test_every_shipped_mission_is_consistent_with_profile_and_scenario(
    path: Path, without_lidar: bool
) -> None:
    mission = load_mission(path, without_lidar=without_lidar)
    profile = load_profile(deploy_folder() / "profiles" / f"{mission.profile}.yaml")
    scenario = load_scenario(mission.scenario)
    check_fits(mission, profile, scenario)
    assert (scenario.navcam is not None) is without_lidar
    if mission.earlier_drive is not None:
        earlier = load_scenario(mission.earlier_drive.scenario)
        assert mission.earlier_drive.robot in earlier.robots
        # The same ground and the same camera, another Sun.
        assert earlier.terrain.model_copy(update={"surface": None}) == scenario.terrain.model_copy(
            update={"surface": None}
        )
        assert (earlier.seed, earlier.robots) == (scenario.seed, scenario.robots)
        assert earlier.terrain.surface != scenario.terrain.surface
    requested_robots = {request.robot for request in mission.requests} | set(
        mission.relative_position.robots if mission.relative_position else ()
    )
    assert requested_robots <= set(mission.robots)
    if mission.limits.guided:
        assert all(
            {"length_m", "width_m", "max_slope_deg"} <= set(profile.robot(r).limits) for r in mission.robots
        )
    half_m = scenario.terrain.fine_half_width_m
    goals = [
        xy
        for tasks in mission.robots.values()
        for task in tasks
        if isinstance(task, GoTo)
        for xy in task.xy_m
    ]
    assert all(abs(v) < 2.0 * half_m for v in goals)


@pytest.mark.parametrize("path", ORBITAL, ids=lambda p: p.stem)
def test_every_shipped_mission_in_orbit_is_consistent_with_profile_and_scenario(path: Path) -> None:
    mission = load_orbit_mission(path)
    profile = load_profile(deploy_folder() / "profiles" / f"{mission.profile}.yaml")
    scenario = load_any_scenario(mission.scenario)
    assert isinstance(scenario, OrbitScenario)
    check_orbit_fits(mission, profile, scenario)
    robots = {task.request.robot for task in mission.tasks if isinstance(task, Ask)}
    assert robots <= {scenario.servicer.name}
    assert set(mission.models) == {scenario.client.name}


def test_a_mission_in_orbit_with_an_unknown_process_is_refused() -> None:
    mission = load_orbit_mission(ORBITAL[0])
    task = RestartProcess(do="restart_process", process="engine")
    profile = load_profile(deploy_folder() / "profiles" / f"{mission.profile}.yaml")
    scenario = load_any_scenario(mission.scenario)
    assert isinstance(scenario, OrbitScenario)
    with pytest.raises(ConfigurationError, match=r"process 'engine': servicer has close_range"):
        check_orbit_fits(mission.model_copy(update={"tasks": (task,)}), profile, scenario)


@pytest.mark.parametrize(
    ("robots", "reason"),
    [
        ("spirit", "robot 'spirit': profile two_rovers has mana, minnie"),
        ("minnie", "scenario outing has mana"),
    ],
)
def test_robots_that_the_profile_or_the_scenario_lacks_are_refused(
    tmp_path: Path, robots: str, reason: str
) -> None:
    mission = load_mission(write_mission(tmp_path, VALID.replace("mana", robots)))
    profile = load_profile(deploy_folder() / "profiles" / "two_rovers.yaml")
    with pytest.raises(ConfigurationError, match=reason):
        check_fits(mission, profile, load_scenario("outing"))


def test_a_variant_replaces_the_fields_of_its_section_and_is_refused_without_one(tmp_path: Path) -> None:
    text = VALID + "limits: {goal_m: 0.5}\nwithout_lidar: {profile: camera_rover, speed: 2.0}\n"
    path = write_mission(tmp_path, text)
    usual, variant = load_mission(path), load_mission(path, without_lidar=True)
    assert (usual.profile, usual.speed) == ("explorer", 4.0)
    assert (variant.profile, variant.speed, variant.limits, variant.robots) == (
        "camera_rover",
        2.0,
        usual.limits,
        usual.robots,
    )
    with pytest.raises(ConfigurationError, match="without_lidar: expected a section"):
        load_mission(write_mission(tmp_path, VALID), without_lidar=True)
    with pytest.raises(ConfigurationError, match=r"without_lidar.*sped"):
        load_mission(write_mission(tmp_path, VALID + "without_lidar: {sped: 2}\n"), without_lidar=True)


def test_tasks_are_parsed(tmp_path: Path) -> None:
    text = VALID + "  minnie: [{do: follow}, {do: meet, robot: mana, distance_m: 2.0}]\n"
    robots = load_mission(write_mission(tmp_path, text)).robots
    assert robots["mana"] == (GoTo(do="go_to", xy_m=(1.0, 2.0)),)
    assert robots["minnie"] == (Follow(do="follow"), Meet(do="meet", robot="mana", distance_m=2.0))


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        (VALID + "sped: 2\n", "sped"),
        (VALID + "speed: 0\n", "speed"),
        (VALID.replace("xy_m: [1.0, 2.0]", "xy_m: [1.0]"), "xy_m"),
        (VALID.replace("go_to", "fly_to"), "fly_to"),
        (
            VALID.replace("go_to, xy_m: [1.0, 2.0]", "meet, robot: minnie, distance_m: 1.0"),
            "cannot meet 'minnie'",
        ),
        (
            VALID.replace("go_to, xy_m: [1.0, 2.0]", "meet, robot: mana, distance_m: 1.0"),
            "cannot meet 'mana'",
        ),
        (VALID.replace("profile: explorer\n", ""), "profile"),
        (VALID + "guidance: {leg_m: -1}\n", "leg_m"),
        (VALID + "limits: {goal: 1}\n", "goal"),
    ],
)
def test_a_wrong_mission_is_refused_by_file_and_key(tmp_path: Path, wrong: str, reason: str) -> None:
    path = write_mission(tmp_path, wrong)
    with pytest.raises(ConfigurationError) as refused:
        load_mission(path)
    assert reason in str(refused.value)
    assert str(path) in str(refused.value)

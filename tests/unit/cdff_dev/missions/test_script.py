# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Mission files: the shipped ones fit their profiles and scenarios; wrong ones are refused by name."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import load_profile
from cdff_dev.missions.commands import DEPLOY
from cdff_dev.missions.script import Follow, GoTo, Meet, check_fits, load_mission
from cdff_dev.simulate.scenario import load_scenario

SHIPPED = sorted((DEPLOY / "missions").glob("*.yaml"))
RIGHT = "doc: A test.\nprofile: explorer\nscenario: outing\nrobots:\n  mana: [{do: go_to, xy_m: [1.0, 2.0]}]\n"


def written(folder: Path, text: str) -> Path:
    path = folder / "mission.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.req("CDFF-DEV-073")
@pytest.mark.parametrize("path", SHIPPED, ids=lambda p: p.stem)
def test_every_shipped_mission_fits_its_profile_and_its_scenario(path: Path) -> None:
    mission = load_mission(path)
    profile = load_profile(DEPLOY / "profiles" / f"{mission.profile}.yaml")
    scenario = load_scenario(mission.scenario)
    check_fits(mission, profile, scenario)
    assert scenario.navcam is None
    asked_of = {ask.robot for ask in mission.requests} | set(mission.together.robots if mission.together else ())
    assert asked_of <= set(mission.robots)
    if mission.judged.guided:
        assert all({"length_m", "width_m", "max_slope_deg"} <= set(profile.robot(r).limits) for r in mission.robots)
    half_m = scenario.terrain.fine_half_width_m
    goals = [xy for tasks in mission.robots.values() for task in tasks if isinstance(task, GoTo) for xy in task.xy_m]
    assert all(abs(v) < 2.0 * half_m for v in goals)


@pytest.mark.parametrize(
    ("robots", "said"),
    [("spirit", "robot 'spirit': profile two_rovers has mana, minnie"), ("minnie", "scenario outing has mana")],
)
def test_robots_that_the_profile_or_the_scenario_lacks_are_refused(tmp_path: Path, robots: str, said: str) -> None:
    mission = load_mission(written(tmp_path, RIGHT.replace("mana", robots)))
    profile = load_profile(DEPLOY / "profiles" / "two_rovers.yaml")
    with pytest.raises(ConfigurationError, match=said):
        check_fits(mission, profile, load_scenario("outing"))


def test_tasks_are_read_as_what_they_say(tmp_path: Path) -> None:
    text = RIGHT + "  minnie: [{do: follow}, {do: meet, robot: mana, keep_m: 2.0}]\n"
    robots = load_mission(written(tmp_path, text)).robots
    assert robots["mana"] == (GoTo(do="go_to", xy_m=(1.0, 2.0)),)
    assert robots["minnie"] == (Follow(do="follow"), Meet(do="meet", robot="mana", keep_m=2.0))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (RIGHT + "sped: 2\n", "sped"),
        (RIGHT + "speed: 0\n", "speed"),
        (RIGHT.replace("xy_m: [1.0, 2.0]", "xy_m: [1.0]"), "xy_m"),
        (RIGHT.replace("go_to", "fly_to"), "fly_to"),
        (RIGHT.replace("go_to, xy_m: [1.0, 2.0]", "meet, robot: minnie, keep_m: 1.0"), "cannot meet 'minnie'"),
        (RIGHT.replace("go_to, xy_m: [1.0, 2.0]", "meet, robot: mana, keep_m: 1.0"), "cannot meet 'mana'"),
        (RIGHT.replace("profile: explorer\n", ""), "profile"),
        (RIGHT + "guiding: {leg_m: -1}\n", "leg_m"),
        (RIGHT + "judged: {goal: 1}\n", "goal"),
    ],
)
def test_a_wrong_mission_is_refused_by_file_and_key(tmp_path: Path, wrong: str, said: str) -> None:
    path = written(tmp_path, wrong)
    with pytest.raises(ConfigurationError) as refused:
        load_mission(path)
    assert said in str(refused.value)
    assert str(path) in str(refused.value)

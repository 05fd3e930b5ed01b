# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The published profile of a robot is complete, comparable, and refused where it does not fit."""

from __future__ import annotations

from typing import Any

import pytest

from cdff_common.bus.message import pack, unpack
from cdff_common.errors import ConfigurationError
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.interfaces.robot_profile import RobotProfile, with_robot
from cdff_common.resources import deploy_folder

PROFILES = sorted((deploy_folder() / "profiles").glob("*.yaml"))
TWO = load_profile(deploy_folder() / "profiles" / "two_rovers.yaml")


@pytest.mark.parametrize("path", PROFILES, ids=lambda path: path.stem)
def test_the_profile_of_each_robot_is_the_same_after_its_transport(path: Any) -> None:
    profile = load_profile(path)
    for robot in profile.robot_ids:
        robot_profile = RobotProfile.of(profile, robot)
        received = RobotProfile.from_dict(unpack(pack(robot_profile.to_dict())), robot)
        assert received.profile == robot_profile.profile
        assert received.revision == robot_profile.revision
        assert received.robot == profile.robot(robot)


def test_another_mount_is_another_revision() -> None:
    robot_profile = RobotProfile.of(TWO, "mana")
    edge = robot_profile.robot.frames[-1].model_copy(update={"translation_m": (0.0, 0.0, 0.123)})
    robot = robot_profile.robot.model_copy(update={"frames": (*robot_profile.robot.frames[:-1], edge)})
    assert (
        RobotProfile(robot_profile.profile.model_copy(update={"robots": (robot,)})).revision
        != robot_profile.revision
    )


def test_a_joined_robot_is_added_or_replaces_its_own_entry() -> None:
    mana, minnie = (RobotProfile.of(TWO, robot) for robot in ("mana", "minnie"))
    assert with_robot(mana.profile, minnie).robots == (mana.robot, minnie.robot)
    renamed = RobotProfile.from_dict(
        mana.to_dict() | {"robots": [mana.to_dict()["robots"][0] | {"doc": "x"}]}, "mana"
    )
    assert with_robot(TWO, renamed).robots == (renamed.robot, minnie.robot)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (None, "got NoneType, expected a map"),
        ([], "got list, expected a map"),
        ({}, "name: Field required; its machine may run another version"),
        ({"name": "m", "robots": [{"id": "mana", "wings": 2}]}, r"robots\.0\.wings"),
        ({"name": "m", "robots": [{"id": "minnie"}]}, "it has the robots minnie, expected mana"),
        ({"name": "m", "robots": [{"id": "mana"}, {"id": "b"}]}, "it has the robots mana, b, expected mana"),
    ],
)
def test_what_is_no_profile_of_the_robot_is_refused(data: Any, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        RobotProfile.from_dict(data, "mana")


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"body": {"name": "moon"}}, r"body\.name is 'moon', but 'mars' in the profile two"),
        (
            {"body": {"name": "mars", "site_lon_deg": 3.0, "site_lat_deg": 1.0}},
            "site is at longitude 3°, latitude 1°",
        ),
        ({"clock": "other"}, "clock is 'other', but 'player'"),
    ],
)
def test_a_robot_of_another_mission_does_not_join(change: dict[str, Any], message: str) -> None:
    body = {"name": "mars", "site_lon_deg": 2.0, "site_lat_deg": 1.0}
    ground = Profile.model_validate({"name": "two", "body": body, "robots": [{"id": "mana"}]})
    data = {"name": "own", "body": {"name": "mars"}, "robots": [{"id": "minnie"}]}
    RobotProfile.from_dict(data, "minnie").check_joins(ground)
    with pytest.raises(ConfigurationError, match=message):
        RobotProfile.from_dict(data | change, "minnie").check_joins(ground)

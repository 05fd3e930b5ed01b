# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The roster reports each robot that joins, changes or leaves once, and refuses what cannot join."""

from __future__ import annotations

from typing import Any

from cdff_common.bus import Reply, keys
from cdff_common.bus.message import pack
from cdff_common.errors import ConfigurationError, NoAnswerError
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.robot_profile import RobotProfile
from cdff_common.loops import Loops
from services.robot_roster import LEAVE_S, RobotRoster

GROUND = Profile.model_validate({"name": "ground", "robots": [{"id": "pico"}]})


class Machines:
    """Bus double with the machines of robots, and the listener of the roster."""

    def __init__(self) -> None:
        self.now_s, self.profiles, self.calls = 0.0, dict[str, Any](), list[str]()
        self.seen: list[tuple[str, str]] = []
        self.refusals: dict[str, str] = {}
        self.fault = ""
        self.roster = RobotRoster(
            self,  # type: ignore[arg-type]  # double
            GROUND,
            self,
            Loops(),
            self.refusals.__setitem__,
            lambda: self.now_s,
        )

    def call(self, key: str, *, timeout_s: float) -> Reply:
        robot = key.split("/")[2]
        self.calls.append(robot)
        if robot not in self.profiles:
            raise NoAnswerError(f"{key}: no service answers")
        return Reply(pack(self.profiles[robot]), "application/msgpack", {})

    def set_robot(self, joined: RobotProfile) -> None:
        if self.fault:
            raise ConfigurationError(self.fault)
        self.seen.append(("set", f"{joined.robot.id}:{joined.robot.doc}"))

    def remove_robot(self, robot: str) -> None:
        self.seen.append(("remove", robot))

    def token(self, robot: str, is_alive: bool) -> None:
        self.roster._on_alive(keys.alive(robot, "supervisor"), is_alive)

    def start(self, robot: str, doc: str = "") -> None:
        self.profiles[robot] = {"name": "own", "robots": [{"id": robot, "doc": doc}]}
        self.token(robot, True)

    def run(self, seconds: float = 0.0) -> None:
        """Let the time pass and handle the robots that are due."""
        self.now_s += seconds
        due = [r for r, at_s in self.roster._due_s.items() if at_s <= self.now_s]
        for robot in due:
            del self.roster._due_s[robot]
            self.roster.update(robot)


def test_a_robot_joins_changes_and_leaves_once_each() -> None:
    machines = Machines()
    machines.start("nano")
    machines.run()
    machines.start("nano")  # the token of the same machine again
    machines.run()
    machines.token("nano", False)
    machines.start("nano", "second")
    machines.run(LEAVE_S)
    machines.token("nano", False)
    machines.run(LEAVE_S)
    assert machines.seen == [("set", "nano:"), ("set", "nano:second"), ("remove", "nano")]


def test_a_link_that_is_closed_for_a_moment_is_no_departure() -> None:
    machines = Machines()
    machines.start("nano")
    machines.run()
    machines.token("nano", False)
    machines.run(0.6 * LEAVE_S)
    machines.token("nano", True)
    machines.run(LEAVE_S)
    assert machines.seen == [("set", "nano:")]


def test_a_robot_of_the_grounds_own_profile_stays_while_it_is_out_of_contact() -> None:
    machines = Machines()
    machines.profiles["pico"] = RobotProfile.of(GROUND, "pico").to_dict()
    machines.token("pico", True)
    machines.run()
    assert machines.seen == []  # the same profile
    machines.start("pico", "changed")
    machines.run()
    machines.token("pico", False)
    machines.run(LEAVE_S)
    assert machines.seen == [("set", "pico:changed")]


def test_a_profile_that_is_not_served_yet_is_asked_for_again() -> None:
    machines = Machines()
    machines.token("nano", True)
    machines.run()
    assert machines.seen == []
    machines.start("nano")
    machines.run(1.0)
    assert machines.seen == [("set", "nano:")]


def test_a_refused_robot_is_named_until_its_machine_ends_and_may_return_corrected() -> None:
    machines = Machines()
    machines.start("nano")
    machines.profiles["nano"]["body"] = {"name": "moon"}
    machines.run()
    assert "body.name is 'moon'" in machines.refusals["nano"]
    machines.token("nano", False)
    machines.run(LEAVE_S)
    assert machines.refusals["nano"] == ""
    machines.start("nano")
    machines.run()
    assert machines.seen == [("set", "nano:")]


def test_a_robot_that_a_service_refuses_is_tried_again_when_it_returns() -> None:
    machines = Machines()
    machines.fault = "no DFPC 'special'"
    machines.start("nano")
    machines.run()
    assert machines.refusals == {"nano": "no DFPC 'special'"}
    machines.fault = ""
    machines.start("nano")
    machines.run()
    assert machines.refusals == {"nano": ""}
    assert machines.seen == [("set", "nano:")]


def test_the_supervisor_of_the_ground_is_no_robot() -> None:
    machines = Machines()
    machines.token("ground", True)
    machines.run()
    assert machines.calls == []

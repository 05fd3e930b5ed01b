# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The autonomy framework of a mission: requests poses and maps of the orchestrator, commands its rover."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cdff_common.bus import Bus
from cdff_common.client import Client
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.errors import (
    DeadlineError,
    FrameNotFoundError,
    ProductNotFoundError,
    RefusedError,
    UnavailableError,
)
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import Profile
from cdff_common.interfaces.registry import Registry
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.traversability.interface import TraversabilityInputs
from cdff_core.dfpcs.navigation_mapping.compound import LIMITS
from cdff_dev.missions.drive_commands import Locomotion
from cdff_dev.missions.guidance import Guidance
from cdff_dev.missions.script import Follow, GoTo, GuidanceParameters, Meet, Return, Straight, Task

#: Deadline of a request, s.
_DEADLINE_S = 40.0
#: Attempts to find a path before giving up.
_MAX_PATH_ATTEMPTS = 4
#: Longest wait near a goal that has not settled, mission seconds.
_MAX_SETTLING_S = 600.0


@contextmanager
def closing_event(event: threading.Event) -> Iterator[None]:
    """Set the event when the block ends, with or without an error."""
    try:
        yield
    finally:
        event.set()


@dataclass(frozen=True, slots=True)
class RequestRecord:
    """One request of the autonomy framework: mission time, subject, duration in seconds, and summary of the
    answer.
    """

    at_s: float
    robot: str
    what: str
    took_s: float
    answer: str


@dataclass(frozen=True, slots=True)
class Arrival:
    """A completed task: mission time and goal in site."""

    robot: str
    task: Task
    t_ns: int
    goal_m: tuple[float, float] | None


@dataclass(slots=True)
class Autonomy:
    """Executes the tasks of one rover in its own thread.

    Parameters
    ----------
    stop : threading.Event
        Stops the thread after the present leg.
    done : mapping of str to threading.Event
        Event of each robot, set when its tasks have ended or failed.
    """

    robot: str
    tasks: tuple[Task, ...]
    guidance: GuidanceParameters
    profile: Profile
    clock: MissionClock
    begin_ns: int
    connect: str
    stop: threading.Event
    say: Callable[[str], None]
    done: Mapping[str, threading.Event]
    asked: list[RequestRecord] = field(default_factory=list)
    arrivals: list[Arrival] = field(default_factory=list)
    legs: int = 0
    _rover: Locomotion = field(init=False)
    _client: Client = field(init=False)

    def run(self) -> None:
        """Run the tasks in order; raises CdffError if one fails."""
        with (
            closing_event(self.done[self.robot]),
            Bus.open(self.connect, name=f"drive-{self.robot}") as bus,
            Client(self.connect) as client,
        ):
            self._rover, self._client = Locomotion(bus, self.robot), client
            home_m = self._position()
            for task in self.tasks:
                goal_m = self._execute(task, home_m)
                goal = None if goal_m is None else (float(goal_m[0]), float(goal_m[1]))
                self.arrivals.append(Arrival(self.robot, task, self.clock.now_ns(), goal))
                self.say(f"{self.robot}: {task.do} done at {self._now_s():.0f} s, {self.legs} legs")

    def _execute(self, task: Task, home_m: FloatArray) -> FloatArray | None:
        """Execute a task and return its goal; None if it has none."""
        match task:
            case Follow():
                self._wait(self._rover.follow()[1])
                return None
            case Straight():
                self._wait(self._rover.drive(np.array([[0.0, 0.0], [task.length_m, 0.0]]))[1])
                return None
            case GoTo():
                return self._drive_to(lambda: np.array(task.xy_m), 0.0)
            case Return():
                return self._drive_to(lambda: home_m, 0.0)
            case Meet():
                return self._drive_to(
                    lambda: self._position(task.robot), task.distance_m, lambda: self._settled(task.robot)
                )

    def _drive_to(
        self, goal: Callable[[], FloatArray], distance_m: float, settled: Callable[[], bool] = lambda: True
    ) -> FloatArray:
        """Drive legs until the goal is near and has settled; return it.

        The goal is evaluated for each leg.
        """
        guidance = Guidance(self.guidance.leg_m)
        failed_plans, left_m, near_since_ns = 0, float("nan"), self.clock.now_ns()
        while self.legs < self.guidance.max_legs and not self.stop.is_set():
            at_m, heading = self._pose()
            is_settled = settled()  # before the goal is read, so that a later move of the goal is noticed
            goal_m = goal()
            to_m = goal_m - at_m
            left_m = float(np.linalg.norm(to_m)) - distance_m
            if left_m <= self.guidance.goal_radius_m:
                if is_settled:
                    return goal_m
                if self.clock.now_ns() > near_since_ns + _MAX_SETTLING_S * NS_PER_S:
                    raise DeadlineError(
                        f"{self.robot}: its goal has not settled within {_MAX_SETTLING_S:g} s"
                    )
                self._wait(self.clock.now_ns() + NS_PER_S)
                continue
            near_since_ns = self.clock.now_ns()
            aim_m = at_m + to_m * left_m / np.linalg.norm(to_m)
            try:
                path = guidance.leg(self._navigation_map(), at_m, aim_m)
            except RefusedError:
                failed_plans += 1
                if failed_plans >= _MAX_PATH_ATTEMPTS:
                    raise
                self._wait(self.clock.now_ns() + 2 * NS_PER_S)
                continue
            failed_plans = 0
            c, s = np.cos(heading), np.sin(heading)
            self._wait(self._rover.drive((path - at_m) @ np.array([[c, -s], [s, c]]))[1])
            self.legs += 1
        raise DeadlineError(f"{self.robot}: not at the goal after {self.legs} legs; {left_m:.1f} m remain")

    def _settled(self, robot: str) -> bool:
        """Return whether a robot's tasks have ended and its position is known.

        Before maps are merged, the position can be wrong by metres.
        """
        covariance = self._client.pose(robot).covariance
        is_known = (
            covariance is not None
            and float(np.linalg.eigvalsh(covariance[:2, :2])[-1]) <= self.guidance.goal_radius_m**2
        )
        return is_known and self.done[robot].is_set()

    def _pose(self) -> tuple[FloatArray, float]:
        """Return the position in site and the heading of the rover from the DPM."""
        start_s = time.monotonic()
        T_site_base = self._client.pose(self.robot).matrix
        self._record_request("pose", start_s, "{:.2f}, {:.2f}, {:.2f} m".format(*T_site_base[:3, 3]))
        return T_site_base[:2, 3], float(np.arctan2(T_site_base[1, 0], T_site_base[0, 0]))

    def _position(self, robot: str | None = None) -> FloatArray:
        """Return the position of a rover in site; waits for its first pose."""
        deadline_s = time.monotonic() + _DEADLINE_S
        while True:
            try:
                return np.asarray(self._client.pose(robot or self.robot).matrix[:2, 3])
            except (FrameNotFoundError, ProductNotFoundError, UnavailableError):
                if time.monotonic() > deadline_s:
                    raise
                time.sleep(0.2)

    def _navigation_map(self) -> NavigationMap:
        """Return the navigation map around the rover."""
        g, start_s = self.guidance, time.monotonic()
        options: dict[str, Any] = {
            "frame": "site",
            "region": f"near:{self.robot}/base,{g.around_m:g}",
            "resolution_m": g.resolution_m,
            "max_age_s": g.max_age_s,
            "deadline_s": _DEADLINE_S,
        }
        if g.ground == "navigation_map":
            answer = self._client.request("navigation_map", robot=self.robot, **options)
            navigation_map: NavigationMap = answer.value
        else:
            answer = self._client.request("dem", robot="any", **options)
            navigation_map = self._assess_terrain(answer.value)
        geometry = navigation_map.geometry
        free = float(np.isin(navigation_map.layer("class"), (1, 2)).mean())
        age_s = answer.delivered.get("age_s", float("nan"))
        self._record_request(
            g.ground,
            start_s,
            f"{geometry.rows} x {geometry.cols} cells, {free:.0%} free, {age_s:.1f} s old",
        )
        return navigation_map

    def _assess_terrain(self, dem: ElevationMap) -> NavigationMap:
        """Return the navigation map of an elevation map with the limits of the rover."""
        limits = self.profile.robot(self.robot).limits
        traversability = Registry.default().make_dfn("Traversability")
        traversability.configure({name: limits[name] for name in LIMITS if name in limits})
        navigation_map: NavigationMap = traversability.process(TraversabilityInputs(dem=dem)).map
        return navigation_map

    def _wait(self, until_ns: int) -> None:
        """Wait until the mission clock reaches ``until_ns``."""
        while self.clock.now_ns() < until_ns and not self.stop.wait(0.05):
            pass

    def _now_s(self) -> float:
        return (self.clock.now_ns() - self.begin_ns) / NS_PER_S

    def _record_request(self, what: str, start_s: float, answer: str) -> None:
        self.asked.append(RequestRecord(self._now_s(), self.robot, what, time.monotonic() - start_s, answer))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The autonomy framework of a simulated rover: it requests poses and maps and commands the rover."""

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
from cdff_common.clock import NS_PER_S
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
from cdff_common.mission_clock import MissionClock
from cdff_common.types import ElevationMap, NavigationMap
from cdff_core.dfns.traversability.interface import TraversabilityInputs
from cdff_core.dfpcs.navigation_mapping.compound import LIMITS
from cdff_dev.missions.drive_commands import Locomotion
from cdff_dev.missions.guidance import Guidance
from cdff_dev.missions.script import Follow, GoTo, GuidanceParameters, Meet, Return, Straight, Task

#: Deadline of a request, s.
_DEADLINE_S = 40.0
#: Number of attempts to plan a path, after which the task fails.
_MAX_PATH_ATTEMPTS = 4
#: Longest wait near a goal that may still move, mission seconds.
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
    """A request of the autonomy framework: mission time, product, duration and summary of the answer."""

    at_s: float
    robot: str
    product: str
    duration_s: float
    answer: str


@dataclass(frozen=True, slots=True)
class Arrival:
    """A completed task: mission time, and goal in site (None if the task has none)."""

    robot: str
    task: Task
    t_ns: int
    goal_m: tuple[float, float] | None


@dataclass(slots=True)
class Autonomy:
    """Executes the tasks of one rover in its own thread.

    Parameters
    ----------
    start_ns : int
        Mission time at the start of the mission.
    stop : threading.Event
        Ends the thread after the current leg.
    print_line : callable
        Prints a line of progress.
    finished_events : mapping of str to threading.Event
        Event of each robot, set when its tasks have ended or failed.

    Attributes
    ----------
    requests : list of RequestRecord
        Requests sent so far.
    arrivals : list of Arrival
        Tasks completed so far.
    legs : int
        Number of legs driven so far.
    """

    robot: str
    tasks: tuple[Task, ...]
    guidance: GuidanceParameters
    profile: Profile
    clock: MissionClock
    start_ns: int
    connect: str
    stop: threading.Event
    print_line: Callable[[str], None]
    finished_events: Mapping[str, threading.Event]
    requests: list[RequestRecord] = field(default_factory=list)
    arrivals: list[Arrival] = field(default_factory=list)
    legs: int = 0
    _rover: Locomotion = field(init=False)
    _client: Client = field(init=False)

    def run(self) -> None:
        """Run the tasks in order; raises CdffError if one fails."""
        with (
            closing_event(self.finished_events[self.robot]),
            Bus.open(self.connect, name=f"drive-{self.robot}") as bus,
            Client(self.connect) as client,
        ):
            self._rover, self._client = Locomotion(bus, self.robot), client
            home_m = self._position()
            for task in self.tasks:
                goal_m = self._execute(task, home_m)
                goal = None if goal_m is None else (float(goal_m[0]), float(goal_m[1]))
                self.arrivals.append(Arrival(self.robot, task, self.clock.now_ns(), goal))
                self.print_line(f"{self.robot}: {task.do} done at {self._now_s():.0f} s, {self.legs} legs")

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
                    lambda: self._position(task.robot), task.distance_m, lambda: self._is_settled(task.robot)
                )

    def _drive_to(
        self, goal: Callable[[], FloatArray], distance_m: float, is_final: Callable[[], bool] = lambda: True
    ) -> FloatArray:
        """Drive to a goal that may move, and return its final position.

        Parameters
        ----------
        goal : callable
            Returns the current position of the goal; it is called before each leg.
        distance_m : float
            Distance from the goal at which the drive ends.
        is_final : callable
            Returns True if the goal does not move any more.
        """
        guidance = Guidance(self.guidance.leg_m)
        failed_plans, remaining_m, near_since_ns = 0, float("nan"), self.clock.now_ns()
        while self.legs < self.guidance.max_legs and not self.stop.is_set():
            position_m, heading_rad = self._pose()
            goal_is_final = (
                is_final()
            )  # evaluated before the goal is read: a goal that is final cannot move after
            goal_m = goal()
            offset_m = goal_m - position_m
            remaining_m = float(np.linalg.norm(offset_m)) - distance_m
            if remaining_m <= self.guidance.goal_radius_m:
                if goal_is_final:
                    return goal_m
                if self.clock.now_ns() > near_since_ns + _MAX_SETTLING_S * NS_PER_S:
                    raise DeadlineError(
                        f"{self.robot}: its goal has not settled within {_MAX_SETTLING_S:g} s"
                    )
                self._wait(self.clock.now_ns() + NS_PER_S)
                continue
            near_since_ns = self.clock.now_ns()
            aim_m = position_m + offset_m * remaining_m / np.linalg.norm(offset_m)
            try:
                path = guidance.leg(self._navigation_map(), position_m, aim_m)
            except RefusedError:
                failed_plans += 1
                if failed_plans >= _MAX_PATH_ATTEMPTS:
                    raise
                self._wait(self.clock.now_ns() + 2 * NS_PER_S)
                continue
            failed_plans = 0
            c, s = np.cos(heading_rad), np.sin(heading_rad)
            self._wait(self._rover.drive((path - position_m) @ np.array([[c, -s], [s, c]]))[1])
            self.legs += 1
        raise DeadlineError(
            f"{self.robot}: not at the goal after {self.legs} legs; {remaining_m:.1f} m remain"
        )

    def _is_settled(self, robot: str) -> bool:
        """Return True if a robot has ended its tasks, and its position is known to ``goal_radius_m``.

        The standard deviation of the position must not exceed the radius. Before the maps of the robots are
        merged, the position can be wrong by metres.
        """
        covariance = self._client.pose(robot).covariance
        is_known = (
            covariance is not None
            and float(np.linalg.eigvalsh(covariance[:2, :2])[-1]) <= self.guidance.goal_radius_m**2
        )
        return is_known and self.finished_events[robot].is_set()

    def _pose(self) -> tuple[FloatArray, float]:
        """Return the position in site and the heading of the rover from the DPM."""
        start_s = time.monotonic()
        T_site_base = self._client.pose(self.robot).matrix
        self._record_request("pose", start_s, "{:.2f}, {:.2f}, {:.2f} m".format(*T_site_base[:3, 3]))
        return T_site_base[:2, 3], float(np.arctan2(T_site_base[1, 0], T_site_base[0, 0]))

    def _position(self, robot: str | None = None) -> FloatArray:
        """Return the position of a rover in site from the DPM; waits for its first pose."""
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
        parameters, start_s = self.guidance, time.monotonic()
        options: dict[str, Any] = {
            "frame": "site",
            "region": f"near:{self.robot}/base,{parameters.around_m:g}",
            "resolution_m": parameters.resolution_m,
            "max_age_s": parameters.max_age_s,
            "deadline_s": _DEADLINE_S,
        }
        if parameters.ground == "navigation_map":
            answer = self._client.request("navigation_map", robot=self.robot, **options)
            navigation_map: NavigationMap = answer.value
        else:
            answer = self._client.request("dem", robot="any", **options)
            navigation_map = self._assess_terrain(answer.value)
        geometry = navigation_map.geometry
        free_fraction = float(np.isin(navigation_map.layer("class"), (1, 2)).mean())
        age_s = answer.delivered.get("age_s", float("nan"))
        self._record_request(
            parameters.ground,
            start_s,
            f"{geometry.rows} x {geometry.cols} cells, {free_fraction:.0%} free, {age_s:.1f} s old",
        )
        return navigation_map

    def _assess_terrain(self, dem: ElevationMap) -> NavigationMap:
        """Return the navigation map of an elevation map, computed with the limits of the rover."""
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
        return (self.clock.now_ns() - self.start_ns) / NS_PER_S

    def _record_request(self, product: str, start_s: float, answer: str) -> None:
        self.requests.append(
            RequestRecord(self._now_s(), self.robot, product, time.monotonic() - start_s, answer)
        )

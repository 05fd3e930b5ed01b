# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The autonomy framework of a mission: asks the orchestrator for poses and maps, tells its rover where to drive."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field

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
from cdff_common.types import NavigationMap
from cdff_core.dfns.traversability._interface import TraversabilityInputs
from cdff_core.dfpcs.navigation_mapping.compound import LIMITS
from cdff_dev.missions.guidance import Guidance
from cdff_dev.missions.orders import Locomotion
from cdff_dev.missions.script import Follow, GoTo, Guiding, Meet, Return, Straight, Task

#: An answer may take so long, seconds.
_ANSWER_S = 40.0
#: How often a rover that sees no way looks again.
_LOOKS = 4
#: How long a rover waits beside its goal for that to settle, mission seconds.
_SETTLES_S = 600.0


@contextmanager
def closing_event(event: threading.Event) -> Iterator[None]:
    """Set the event when the block is left, however it is."""
    try:
        yield
    finally:
        event.set()


@dataclass(frozen=True, slots=True)
class Asked:
    """One request of the autonomy framework: when (mission seconds), for what, and how long the answer took."""

    at_s: float
    robot: str
    what: str
    took_s: float
    answer: str


@dataclass(frozen=True, slots=True)
class Arrival:
    """A task that was done: when (mission time), the goal in site, and where the rover believes to be."""

    robot: str
    task: Task
    t_ns: int
    goal_m: tuple[float, float] | None
    believed_m: tuple[float, float]


@dataclass(slots=True)
class Autonomy:
    """Carries out the tasks of one rover, in a thread of its own.

    Parameters
    ----------
    stop : threading.Event
        Ends it between two legs.
    done : mapping of str to threading.Event
        Of each robot: set when its tasks are done, or cannot be.
    """

    robot: str
    tasks: tuple[Task, ...]
    guiding: Guiding
    profile: Profile
    clock: MissionClock
    begin_ns: int
    connect: str
    stop: threading.Event
    say: Callable[[str], None]
    done: Mapping[str, threading.Event]
    asked: list[Asked] = field(default_factory=list)
    arrivals: list[Arrival] = field(default_factory=list)
    legs: int = 0
    _rover: Locomotion = field(init=False)
    _client: Client = field(init=False)

    def run(self) -> None:
        """Do task after task; raises CdffError where one cannot be done."""
        with (
            closing_event(self.done[self.robot]),
            Bus.open(self.connect, name=f"drive-{self.robot}") as bus,
            Client(self.connect) as client,
        ):
            self._rover, self._client = Locomotion(bus, self.robot), client
            home_m = self._where()
            for task in self.tasks:
                goal_m = self._do(task, home_m)
                at_m = self._where()
                goal = None if goal_m is None else (float(goal_m[0]), float(goal_m[1]))
                self.arrivals.append(Arrival(self.robot, task, self.clock.now_ns(), goal, (at_m[0], at_m[1])))
                self.say(f"{self.robot}: {task.do} done at {self._now_s():.0f} s, {self.legs} legs")

    def _do(self, task: Task, home_m: FloatArray) -> FloatArray | None:
        """Carry out a task; returns the goal it ended at."""
        match task:
            case Follow():
                self._wait(self._rover.follow()[1])
                return None
            case Straight():
                self._wait(self._rover.drive(np.array([[0.0, 0.0], [task.length_m, 0.0]]))[1])
                return None
            case GoTo():
                return self._guided(lambda: np.array(task.xy_m), 0.0)
            case Return():
                return self._guided(lambda: home_m, 0.0)
            case Meet():
                return self._guided(lambda: self._where(task.robot), task.keep_m, lambda: self._settled(task.robot))

    def _guided(
        self, goal: Callable[[], FloatArray], keep_m: float, settled: Callable[[], bool] = lambda: True
    ) -> FloatArray:
        """Drive leg after leg until the goal, asked again each time, is near and, where it may move, has settled."""
        guidance = Guidance(self.guiding.leg_m)
        looks, left_m, beside_ns = 0, float("nan"), self.clock.now_ns()
        while self.legs < self.guiding.most_legs and not self.stop.is_set():
            at_m, heading = self._pose()
            stays = settled()  # before the goal is asked: what moved it meanwhile is seen
            goal_m = goal()
            to_m = goal_m - at_m
            left_m = float(np.linalg.norm(to_m)) - keep_m
            if left_m <= self.guiding.arrived_m:
                if stays:
                    return goal_m
                if self.clock.now_ns() > beside_ns + _SETTLES_S * NS_PER_S:
                    raise DeadlineError(f"{self.robot}: what it drives to has not settled within {_SETTLES_S:g} s")
                self._wait(self.clock.now_ns() + NS_PER_S)
                continue
            beside_ns = self.clock.now_ns()
            aim_m = at_m + to_m * left_m / np.linalg.norm(to_m)
            try:
                way = guidance.leg(self._ground(), at_m, aim_m)
            except RefusedError:
                looks += 1
                if looks >= _LOOKS:
                    raise
                self._wait(self.clock.now_ns() + 2 * NS_PER_S)
                continue
            looks = 0
            c, s = np.cos(heading), np.sin(heading)
            self._wait(self._rover.drive((way - at_m) @ np.array([[c, -s], [s, c]]))[1])
            self.legs += 1
        raise DeadlineError(f"{self.robot}: not at the goal after {self.legs} legs; {left_m:.1f} m are left")

    def _settled(self, robot: str) -> bool:
        """Whether a robot stays where it is and is known to be there: before maps are merged it may be metres off."""
        covariance = self._client.pose(robot).covariance
        known = (
            covariance is not None and float(np.linalg.eigvalsh(covariance[:2, :2])[-1]) <= self.guiding.arrived_m**2
        )
        return known and self.done[robot].is_set()

    def _pose(self) -> tuple[FloatArray, float]:
        """Place in site and heading of the rover, as the DPM holds them now."""
        began_s = time.monotonic()
        T = self._client.pose(self.robot).matrix
        self._note("pose", began_s, f"{T[0, 3]:.2f}, {T[1, 3]:.2f}, {T[2, 3]:.2f} m")
        return T[:2, 3], float(np.arctan2(T[1, 0], T[0, 0]))

    def _where(self, robot: str | None = None) -> FloatArray:
        """Place of a rover in site; waits for its first pose."""
        deadline_s = time.monotonic() + _ANSWER_S
        while True:
            try:
                return np.asarray(self._client.pose(robot or self.robot).matrix[:2, 3])
            except (FrameNotFoundError, ProductNotFoundError, UnavailableError):
                if time.monotonic() > deadline_s:
                    raise
                time.sleep(0.2)

    def _ground(self) -> NavigationMap:
        """What is known of the ground around the rover, rated."""
        g, began_s = self.guiding, time.monotonic()
        wished = {
            "frame": "site", "region": f"near:{self.robot}/base,{g.around_m:g}", "resolution_m": g.resolution_m,
            "max_age_s": g.max_age_s, "deadline_s": _ANSWER_S,
        }  # fmt: skip
        if g.ground == "navigation_map":
            answer = self._client.request("navigation_map", robot=self.robot, **wished)
            made: NavigationMap = answer.value
        else:
            answer = self._client.request("dem", robot="any", **wished)
            made = self._rated(answer.value)
        free = float(np.isin(made.layer("class"), (1, 2)).mean())
        age_s = answer.delivered.get("age_s", float("nan"))
        self._note(
            g.ground, began_s, f"{made.geometry.rows} x {made.geometry.cols} cells, {free:.0%} free, {age_s:.1f} s old"
        )
        return made

    def _rated(self, dem: object) -> NavigationMap:
        limits = self.profile.robot(self.robot).limits
        rating = Registry.default().make_dfn("Traversability")
        rating.configure({name: limits[name] for name in LIMITS if name in limits})
        made: NavigationMap = rating.process(TraversabilityInputs(dem=dem)).map
        return made

    def _wait(self, until_ns: int) -> None:
        """Until the mission clock shows a time."""
        while self.clock.now_ns() < until_ns and not self.stop.wait(0.05):
            pass

    def _now_s(self) -> float:
        return (self.clock.now_ns() - self.begin_ns) / NS_PER_S

    def _note(self, what: str, began_s: float, answer: str) -> None:
        self.asked.append(Asked(self._now_s(), self.robot, what, time.monotonic() - began_s, answer))

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The autonomy framework of a simulated servicer: it requests tracks and models and commands displacements.

It has no other source of information than the answers to its requests over Zenoh and the profile.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from cdff_common.bus import Bus
from cdff_common.clock import NS_PER_S
from cdff_common.errors import CdffError, RefusedError, UnavailableError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_common.interfaces.profile import Profile
from cdff_common.mission_clock import MissionClock
from cdff_common.types import ObjectTrack
from cdff_dev.missions.orbit.commands import Thrusters
from cdff_dev.missions.orbit.link import InterruptibleLink
from cdff_dev.missions.orbit.script import (
    Approach,
    Ask,
    CutLink,
    FlyAround,
    LoseSensor,
    OrbitRequest,
    RestartProcess,
    Task,
    Wait,
)
from cdff_dev.missions.requests import Outcome, send_request

#: Deadline of the requests for guidance, seconds of real time, and greatest number of attempts of each.
_DEADLINE_S, _ATTEMPTS = 60.0, 4
#: Largest age of a track for guidance, mission seconds.
_MAX_AGE_S = 6.0
#: Interval between requests during a motion, mission seconds.
_REFRESH_S = 8.0
#: Shortest duration of a motion, and time after it until its end is in the track, mission seconds.
_SHORTEST_S, _SETTLING_S = 6.0, 7.0


@dataclass(frozen=True, slots=True)
class Event:
    """An event of the mission: time since its start, seconds, and description."""

    at_s: float
    text: str


@dataclass(slots=True)
class OrbitAutonomy:
    """Executes the tasks of the servicer.

    Parameters
    ----------
    client : str
        Name of the client.
    start_ns : int
        Mission time at the start of the mission.
    link : InterruptibleLink
        Link over which requests are sent.
    restart : callable
        Kills the process with this name in the profile.
    stop : threading.Event
        Ends the tasks.

    Attributes
    ----------
    outcomes : list of Outcome
        Outcomes of all requests; the faults of a request whose refusal is expected, or that is repeated
        successfully, are listed in ``refusals``.
    refusals : list of (float, str, str)
        Time, request and reason of each refused request that was expected to be refused or was repeated.
    events : list of Event
        Motions and faults.
    steps : int
        Number of displacements.
    """

    robot: str
    client: str
    tasks: tuple[Task, ...]
    profile: Profile
    clock: MissionClock
    start_ns: int
    link: InterruptibleLink
    http: str
    restart: Callable[[str], None]
    stop: threading.Event
    print_line: Callable[[str], None]
    outcomes: list[Outcome] = field(default_factory=list)
    refusals: list[tuple[float, str, str]] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    steps: int = 0
    _thrusters: Thrusters = field(init=False)

    def run(self, bus: Bus) -> None:
        """Execute the tasks in order; raises CdffError at the first task that fails.

        ``bus`` carries the commands to the thrusters. They are on board the servicer, so that interruptions
        of the link do not affect them.
        """
        self._thrusters = Thrusters(bus, self.robot)
        for task in self.tasks:
            if self.stop.is_set():
                return
            self._execute(task)

    def _execute(self, task: Task) -> None:
        match task:
            case Wait():
                self._wait_until(self.clock.now_ns() + round(task.duration_s * NS_PER_S))
            case Approach(by="bearing"):
                self._approach(task, self._bearing_step)
            case Approach():
                self._approach(task, self._pose_step)
            case FlyAround():
                self._fly_around(task)
            case Ask():
                self._ask(task.request, expect=task.expect)
            case LoseSensor():
                self._thrusters.lose_sensor(task.sensor, task.duration_s)
                self._note(f"fault: {task.sensor} lost for {task.duration_s:g} s")
            case RestartProcess():
                self.restart(task.process)
                self._note(f"fault: process {task.process} killed")
            case CutLink():
                self._cut_link(task)

    # -- motions

    def _approach(self, task: Approach, step_of: Callable[[Approach], tuple[FloatArray, float, str]]) -> None:
        """Request the track and move, until the distance is reached; raises RefusedError."""
        for _ in range(task.max_steps):
            direction, range_m, frame = step_of(task)
            excess_m = range_m - task.distance_m
            if excess_m <= task.tolerance * task.distance_m:
                self._note(f"distance of at least {range_m:.1f} m reached")
                return
            length_m = min(excess_m, task.max_step_m)
            duration_s = max(length_m / task.speed_m_s, _SHORTEST_S)
            self._move(length_m * direction, duration_s, frame, self._track_request(task))
        raise RefusedError(
            f"approach to {task.distance_m:g} m: not reached in {task.max_steps} steps", ("not_reached",)
        )

    def _bearing_step(self, task: Approach) -> tuple[FloatArray, float, str]:
        """Return the direction (3,) to the client, the lower limit of its range, metres, and the frame."""
        answer = self._ask(self._track_request(task), expect="answer").answer
        assert answer is not None  # otherwise an error was raised
        track: ObjectTrack = answer.value
        azimuth, elevation, _, _, range_m, sigma_m = track.data.bearings[-1].tolist()
        low_m = answer.header.quality.metrics.get("range_low_m", math.nan)
        if not math.isfinite(low_m):
            low_m = range_m - 3.0 * sigma_m
        if not math.isfinite(low_m):
            raise RefusedError("approach: the range is unobservable", ("range_unobservable",))
        direction = np.array(
            [
                math.cos(elevation) * math.cos(azimuth),
                math.cos(elevation) * math.sin(azimuth),
                math.sin(elevation),
            ]
        )
        return direction, low_m, track.metadata.frame_id

    def _pose_step(self, task: Approach) -> tuple[FloatArray, float, str]:
        """Return the direction (3,) to the client and its distance, metres, in the base."""
        position_m = self._position_m(task)
        distance_m = float(np.linalg.norm(position_m))
        return position_m / distance_m, distance_m, f"{self.robot}/base"

    def _fly_around(self, task: FlyAround) -> None:
        """Move around the client; each step starts from the estimated position."""
        R = se3.exp_so3([0.0, 0.0, math.radians(task.angle_deg / task.steps)])
        for _ in range(task.steps):
            position_m = self._position_m(task)
            target_m = position_m - R @ position_m * task.distance_m / np.linalg.norm(position_m)
            self._move(target_m, task.step_s, f"{self.robot}/base", self._track_request(task))
            for request in task.refresh:
                self._ask(request, expect="answer")
        self._note(f"flight around the client by {task.angle_deg:g} deg")

    def _move(self, displacement_m: FloatArray, duration_s: float, frame: str, request: OrbitRequest) -> None:
        """Command a motion and wait for its end; the track is requested meanwhile, so that it continues."""
        _, end_ns = self._thrusters.move(displacement_m, duration_s, frame)
        self.steps += 1
        length_m = float(np.linalg.norm(displacement_m))
        self._note(f"motion of {length_m:.2f} m in {duration_s:.0f} s")
        while (end_ns - self.clock.now_ns()) > _REFRESH_S * NS_PER_S and not self.stop.is_set():
            self._wait_until(self.clock.now_ns() + round(_REFRESH_S * NS_PER_S))
            self._refresh(request)
        self._wait_until(end_ns + round(_SETTLING_S * NS_PER_S))

    # -- requests

    def _position_m(self, task: Approach | FlyAround) -> FloatArray:
        """Return the position (3,) of the client in the base from its track in a frame of the servicer."""
        answer = self._ask(self._track_request(task), expect="answer").answer
        assert answer is not None  # otherwise an error was raised
        track: ObjectTrack = answer.value
        frames = self.profile.robot(self.robot).frame_graph()
        mount = frames.lookup(f"{self.robot}/base", task.frame, 0).matrix
        return np.asarray(se3.transform_points(mount, track.data.poses[-1:, :3])[0])

    def _track_request(self, task: Approach | FlyAround) -> OrbitRequest:
        """Return the request of the track in the frame and with the accuracy of a task."""
        return OrbitRequest(
            type="track",
            robot=self.robot,
            frame=task.frame,
            max_age_s=_MAX_AGE_S,
            deadline_ms=round(1000 * _DEADLINE_S),
            max_sigma_m=task.max_sigma_m,
            max_sigma_deg=task.max_sigma_deg,
        )

    def _refresh(self, request: OrbitRequest) -> None:
        """Send a request once during a motion; a refusal is recorded and has no consequence."""
        timed = request.model_copy(update={"at_s": round(self._now_s(), 1), "deadline_ms": 5000})
        outcome = send_request(timed, self.clock, self.link.endpoint, self.http)
        if outcome.faults:
            self.refusals.append((timed.at_s, timed.title, "; ".join(outcome.faults)))
        else:
            self.outcomes.append(outcome)

    def _ask(self, request: OrbitRequest, *, expect: str) -> Outcome:
        """Send a request, again if it is refused; raises UnavailableError if no attempt is successful.

        A request whose refusal is expected is sent once.
        """
        for attempt in range(1, _ATTEMPTS + 1):
            timed = request.model_copy(update={"at_s": round(self._now_s(), 1)})
            outcome = send_request(timed, self.clock, self.link.endpoint, self.http)
            if expect == "refusal" or (outcome.faults and attempt < _ATTEMPTS and not self.stop.is_set()):
                reason = "; ".join(outcome.faults) or "answered, although a refusal was expected"
                self.refusals.append((timed.at_s, timed.title, reason))
                self.print_line(f"{timed.at_s:6.0f} s  refused: {timed.title}: {reason}")
                if expect == "refusal":
                    if outcome.answer is not None:
                        raise UnavailableError(f"{timed.title}: {reason}")
                    return outcome
                time.sleep(0.5)
                continue
            break
        self.outcomes.append(outcome)
        self.print_line(f"{timed.at_s:6.0f} s  {outcome}")
        if outcome.faults:
            raise UnavailableError(f"{request.title}: {'; '.join(outcome.faults)}")
        return outcome

    def _cut_link(self, task: CutLink) -> None:
        """Interrupt the link, send a request during the outage, and restore the link."""
        self._note(f"fault: link interrupted for {task.duration_s:g} s")
        end_s = time.monotonic() + task.duration_s
        self.link.cut()
        try:
            self._ask(task.request, expect="refusal")
            while time.monotonic() < end_s and not self.stop.wait(0.1):
                pass
        finally:
            self.link.restore()
        self._note("link restored")

    # -- time

    def _now_s(self) -> float:
        return (self.clock.now_ns() - self.start_ns) / NS_PER_S

    def _wait_until(self, t_ns: int) -> None:
        while self.clock.now_ns() < t_ns:
            if self.stop.wait(0.05):
                return

    def _note(self, text: str) -> None:
        event = Event(round(self._now_s(), 1), text)
        self.events.append(event)
        self.print_line(f"{event.at_s:6.0f} s  {text}")


def describe_error(robot: str, error: Exception) -> str:
    """Return the text that reports an error because of which the tasks were not completed."""
    return (
        f"{robot}: {error}" if isinstance(error, CdffError) else f"{robot}: {type(error).__name__}: {error}"
    )

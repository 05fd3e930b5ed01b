# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission: start of the system and the simulated rovers, driving, requests, assessment, end."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.bus import Bus
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.types import ElevationMap
from cdff_dev.missions.autonomy import Arrival, Autonomy
from cdff_dev.missions.orbital_map import seen_from_orbit, store
from cdff_dev.missions.report import Report, elevation_around, processes_under
from cdff_dev.missions.requests import Outcome, run_requests, wait_for_clock
from cdff_dev.missions.score import Score, located, reached
from cdff_dev.missions.script import Mission
from cdff_dev.missions.stage import Stage
from cdff_dev.missions.terrain import driven, mapped
from cdff_dev.missions.tracks import (
    RelativePositionErrors,
    Track,
    Truth,
    elevation_window,
    estimated_track,
    path_lengths_m,
    placed_in_site,
    read_truth,
    relative_errors,
    settled_assessment,
)
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.world import cast_scene, make_world

logger = logging.getLogger(__name__)

#: Longest wait for the clock, which starts after the world has been simulated, seconds.
_WORLD_TIMEOUT_S = 300.0
#: Elevation is compared around poses along the path: their spacing, the radius and the cell size, metres.
_MAP_EVERY_M, _MAP_AROUND_M, _MAP_CELL_M = 60.0, 10.0, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Score of a mission, its unmet limits, and its report."""

    score: Score
    faults: list[str]
    remarks: list[str]
    report: Report


def run(
    name: str,
    mission: Mission,
    scenario: Scenario,
    stage: Stage,
    bus: Bus,
    speed: float,
    say: Callable[[str], None],
) -> Result:
    """Run a mission on a system that is ready; raises CdffError if the system ends."""
    profile = stage.profile
    if mission.orbital is not None:
        say(f"simulating the orbital elevation model of scenario {mission.scenario}")
        first = next(iter(mission.robots))
        T_site_odom = profile.robot(first).frame_graph().lookup("site", f"{first}/odom", 0).matrix
        orbital = seen_from_orbit(make_world(scenario), first, T_site_odom, mission.orbital)
        store(bus, orbital, mission.orbital.robot)
    truth_log = stage.log_dir.parent / "truth"
    stage.drive(mission.scenario, scenario.seed, speed, truth_log)
    say(f"simulating the terrain of scenario {mission.scenario}")
    clock, start_ns = wait_for_clock(bus, stage.check_running, _WORLD_TIMEOUT_S)
    started_s = time.monotonic()
    rovers, unfinished, outcomes = _drive_all(mission, clock, start_ns, stage, say)
    mission_s, took_s = (clock.now_ns() - start_ns) / NS_PER_S, time.monotonic() - started_s
    say(f"{mission_s:.0f} s of mission in {took_s:.0f} s; comparing with the ground truth")
    stage.check_running()
    processes = processes_under(stage.supervisor_pid)
    stage.end_drive()
    truths = placed_in_site(read_truth(truth_log, list(mission.robots)), profile)
    remarks, faults = _relative_position(mission, stage, truths)
    arrivals = [arrival for rover in rovers for arrival in rover.arrivals]
    tracks = [estimated_track(profile, robot, stage.http, truth) for robot, truth in truths.items()]
    score = _score(mission, scenario, truths, tracks, arrivals, unfinished, stage, bus)
    unanswered = [f"{o.ask.title}: {'; '.join(o.faults)}" for o in outcomes if o.faults]
    faults = [*score.faults(mission.limits), *unanswered, *faults]
    verdict = [] if faults else ["All criteria of the mission are met."]
    duration = f"{mission_s:.0f} s of mission time, run in {took_s:.0f} s."
    report = Report(
        title=f"Mission {name}",
        paragraphs=[mission.doc, profile.doc, duration, *verdict, *score.lines(), *remarks],
        faults=faults,
        tracks=tracks,
        ground=elevation_around(bus, tracks),
        outcomes=outcomes,
        processes=processes,
        start_ns=start_ns,
        arrivals=arrivals,
        guidance_requests=[record for rover in rovers for record in rover.asked],
    )
    return Result(score, faults, remarks, report)


def _drive_all(
    mission: Mission,
    clock: MissionClock,
    start_ns: int,
    stage: Stage,
    say: Callable[[str], None],
) -> tuple[list[Autonomy], list[str], list[Outcome]]:
    """Run the tasks of every rover and send the requests of the mission meanwhile."""
    stop, unfinished = threading.Event(), list[str]()
    done = {robot: threading.Event() for robot in mission.robots}
    rovers = [
        Autonomy(
            robot, tasks, mission.guidance, stage.profile, clock, start_ns, stage.connect, stop, say, done
        )
        for robot, tasks in mission.robots.items()
    ]

    def drive(rover: Autonomy) -> None:
        try:
            rover.run()
        except CdffError as error:
            unfinished.append(f"{rover.robot}: {error}")
        except Exception as error:  # a bug must be reported, not end the thread silently
            logger.exception("%s", rover.robot)
            unfinished.append(f"{rover.robot}: {type(error).__name__}: {error}")
        else:
            return
        say(unfinished[-1])

    outcomes: list[Outcome] = []

    def ask() -> None:
        outcomes.extend(
            run_requests(mission.requests, clock, start_ns, stage.connect, stage.http, lambda _outcome: None)
        )

    threads = [
        threading.Thread(target=drive, args=(r,), name=f"drive {r.robot}", daemon=True) for r in rovers
    ]
    if mission.requests:
        threads.append(threading.Thread(target=ask, name="ask", daemon=True))
    for thread in threads:
        thread.start()
    try:
        while any(thread.is_alive() for thread in threads):
            stage.check_running()
            time.sleep(0.2)
    finally:
        stop.set()
    if len(outcomes) < len(mission.requests):
        unfinished.append(f"{len(outcomes)} of {len(mission.requests)} requests ended")
    return rovers, unfinished, outcomes


def _relative_position(
    mission: Mission, stage: Stage, truths: dict[str, Truth]
) -> tuple[list[str], list[str]]:
    """Assess the relative position of two robots until it is within its limit or ``wait_s`` has passed.

    Return remarks and faults.
    """
    limit = mission.relative_position
    if limit is None:
        return [], []

    def errors_now() -> RelativePositionErrors:
        tracks = [estimated_track(stage.profile, robot, stage.http, truths[robot]) for robot in limit.robots]
        return relative_errors(tracks, limit.within_m)

    def is_within(errors: RelativePositionErrors) -> bool:
        return errors.pairs > 0 and errors.largest_m <= limit.max_error_m

    errors = settled_assessment(errors_now, is_within, limit.wait_s)
    line = f"error of the position of {limit.robots[1]} relative to {limit.robots[0]}: {errors}"
    return ([line], []) if is_within(errors) else ([], [f"{line}, expected at most {limit.max_error_m:g} m"])


def _score(
    mission: Mission,
    scenario: Scenario,
    truths: dict[str, Truth],
    tracks: Sequence[Track],
    arrivals: Sequence[Arrival],
    unfinished: Sequence[str],
    stage: Stage,
    bus: Bus,
) -> Score:
    world = make_world(scenario)
    scene = cast_scene(world.relief, world.rocks)
    crossed_terrain = []
    for robot, truth in truths.items():
        T_world_base = np.linalg.inv(truth.T_site_world) @ truth.poses
        limits = stage.profile.robot(robot).limits
        crossed_terrain.append(driven(robot, T_world_base, scene, scenario.chassis.base_height_m, limits))
    # An orbital model is not a map of the rover: with one, only the rover's own map is requested.
    windows = [
        window
        for robot, truth in truths.items()
        for window in _windows(bus, truth, robot if mission.orbital else "any")
    ]
    maps = [window for window in windows if window is not None]
    T_site_world = next(iter(truths.values())).T_site_world
    return Score(
        tuple(located(track) for track in tracks),
        tuple(reached(arrivals, truths)),
        tuple(crossed_terrain),
        replace(mapped(maps, T_site_world, scene), blank=len(windows) - len(maps)),
        tuple(unfinished),
    )


def _windows(bus: Bus, truth: Truth, robot: str) -> list[ElevationMap | None]:
    """Return the elevation of ``robot`` in the DPM around poses along a path, None if it is unknown."""
    s = path_lengths_m(truth.positions_m[:, :2])
    windows: list[ElevationMap | None] = []
    for row in np.searchsorted(s, np.arange(0.0, s[-1], _MAP_EVERY_M)):
        x, y = truth.positions_m[row, :2]
        region = f"circle:{x:.2f},{y:.2f},{_MAP_AROUND_M:g}"
        try:
            windows.append(elevation_window(bus, region, _MAP_CELL_M, robot=robot))
        except ProductNotFoundError:
            windows.append(None)
    return windows

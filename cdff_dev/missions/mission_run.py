# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run of a mission on a running system: simulated rovers, driving, requests, score and report."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from cdff_common.bus import Bus
from cdff_common.clock import NS_PER_S
from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.mission_clock import MissionClock
from cdff_common.types import ElevationMap
from cdff_dev.missions.autonomy import Arrival, Autonomy
from cdff_dev.missions.earlier_drive import located_images, map_of_drive, store_visual_map
from cdff_dev.missions.orbital_map import simulate_orbital_model, store_orbital_model
from cdff_dev.missions.report import Report, elevation_around, resource_usage
from cdff_dev.missions.requests import Outcome, run_requests, wait_for_clock
from cdff_dev.missions.score import Score, goal_results, position_errors
from cdff_dev.missions.script import Mission
from cdff_dev.missions.stage import Stage
from cdff_dev.missions.terrain import assess_crossed_terrain, compare_elevation
from cdff_dev.missions.tracks import (
    RelativePositionErrors,
    Track,
    Truth,
    assess_until_settled,
    elevation_window,
    estimated_track,
    path_lengths_m,
    read_truth,
    relative_position_errors,
    transform_to_site,
)
from cdff_dev.simulate.scenario import Scenario
from cdff_dev.simulate.world import cast_scene, make_world

logger = logging.getLogger(__name__)

#: Longest wait for the mission clock, which starts when the terrain has been simulated, seconds.
_WORLD_TIMEOUT_S = 300.0
#: Comparison of elevation around poses of the path: spacing of the poses, radius, cell size, metres.
_MAP_EVERY_M, _MAP_AROUND_M, _MAP_CELL_M = 60.0, 10.0, 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """Score, faults, remarks and report of a mission."""

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
    print_line: Callable[[str], None],
) -> Result:
    """Run a mission on a system that is ready; raises CdffError if a process of the system ends."""
    profile = stage.profile
    if mission.orbital is not None:
        print_line(f"simulating the orbital elevation model of scenario {mission.scenario}")
        robot = next(iter(mission.robots))
        T_site_odom = profile.robot(robot).frame_graph().lookup("site", f"{robot}/odom", 0).matrix
        orbital = simulate_orbital_model(make_world(scenario), robot, T_site_odom, mission.orbital)
        store_orbital_model(bus, orbital, mission.orbital.robot)
    if mission.earlier_drive is not None:
        print_line(
            f"simulating the drive of scenario {mission.earlier_drive.scenario} and mapping its images"
        )
        visual_map = map_of_drive(mission.earlier_drive)
        store_visual_map(bus, visual_map, mission.earlier_drive.robot)
        print_line(f"  {len(visual_map.keyframes)} keyframes are stored in the DPM")
    truth_log = stage.log_dir.parent / "truth"
    stage.drive(mission.scenario, scenario.seed, speed, truth_log)
    print_line(f"simulating the terrain of scenario {mission.scenario}")
    clock, start_ns = wait_for_clock(bus, stage.check_running, _WORLD_TIMEOUT_S)
    start_s = time.monotonic()
    rovers, unfinished, outcomes = _drive_all(mission, clock, start_ns, stage, print_line)
    mission_s, run_s = (clock.now_ns() - start_ns) / NS_PER_S, time.monotonic() - start_s
    print_line(f"{mission_s:.0f} s of mission time in {run_s:.0f} s; comparing with the ground truth")
    stage.check_running()
    located = list(located_images(bus, mission)) if mission.earlier_drive is not None else []
    processes = resource_usage(stage.supervisor_pid)  # before end_drive(), while all services still run
    stage.end_drive()
    truths = transform_to_site(read_truth(truth_log, list(mission.robots)), profile)
    remarks, faults = _relative_position(mission, stage, truths)
    remarks += located
    arrivals = [arrival for rover in rovers for arrival in rover.arrivals]
    tracks = [estimated_track(profile, robot, stage.http, truth) for robot, truth in truths.items()]
    score = _score(mission, scenario, truths, tracks, arrivals, unfinished, stage, bus)
    unanswered = [f"{o.request.title}: {'; '.join(o.faults)}" for o in outcomes if o.faults]
    faults = [*score.faults(mission.limits), *unanswered, *faults]
    success = [] if faults else ["All limits of the mission are met."]
    duration = f"{mission_s:.0f} s of mission time, run in {run_s:.0f} s."
    report = Report(
        title=f"Mission {name}",
        paragraphs=[mission.doc, profile.doc, duration, *success, *score.lines(), *remarks],
        faults=faults,
        tracks=tracks,
        ground=elevation_around(bus, tracks),
        outcomes=outcomes,
        processes=processes,
        start_ns=start_ns,
        arrivals=arrivals,
        guidance_requests=[record for rover in rovers for record in rover.requests],
    )
    return Result(score, faults, remarks, report)


def _drive_all(
    mission: Mission,
    clock: MissionClock,
    start_ns: int,
    stage: Stage,
    print_line: Callable[[str], None],
) -> tuple[list[Autonomy], list[str], list[Outcome]]:
    """Run the tasks of every rover and send the requests of the mission, in threads.

    Return the rovers, the errors of rovers and requests that did not end, and the outcomes of the requests.
    """
    stop, unfinished = threading.Event(), list[str]()
    finished_events = {robot: threading.Event() for robot in mission.robots}
    rovers = [
        Autonomy(
            robot,
            tasks,
            mission.guidance,
            stage.profile,
            clock,
            start_ns,
            stage.connect,
            stop,
            print_line,
            finished_events,
        )
        for robot, tasks in mission.robots.items()
    ]

    def drive(rover: Autonomy) -> None:
        try:
            rover.run()
        except CdffError as error:
            unfinished.append(f"{rover.robot}: {error}")
        except Exception as error:  # a bug must be reported, not end the thread silently
            logger.exception("tasks of %s", rover.robot)
            unfinished.append(f"{rover.robot}: {type(error).__name__}: {error}")
        else:
            return
        print_line(unfinished[-1])

    outcomes: list[Outcome] = []

    def send_requests() -> None:
        outcomes.extend(
            run_requests(mission.requests, clock, start_ns, stage.connect, stage.http, lambda _outcome: None)
        )

    threads = [
        threading.Thread(target=drive, args=(r,), name=f"drive {r.robot}", daemon=True) for r in rovers
    ]
    if mission.requests:
        threads.append(threading.Thread(target=send_requests, name="requests", daemon=True))
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
        return relative_position_errors(tracks, limit.within_m)

    def is_within(errors: RelativePositionErrors) -> bool:
        return errors.pairs > 0 and errors.largest_m <= limit.max_error_m

    errors = assess_until_settled(errors_now, is_within, limit.wait_s)
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
    """Return the score of a finished mission against the ground truth."""
    world = make_world(scenario)
    scene = cast_scene(world.relief, world.rocks)
    crossed_terrain = []
    for robot, truth in truths.items():
        T_world_base = np.linalg.inv(truth.T_site_world) @ truth.poses
        limits = stage.profile.robot(robot).limits
        crossed_terrain.append(
            assess_crossed_terrain(robot, T_world_base, scene, scenario.chassis.base_height_m, limits)
        )
    # With an orbital model in the DPM, only the maps of the rover itself are requested and compared.
    windows = [
        window
        for robot, truth in truths.items()
        for window in _windows(bus, truth, robot if mission.orbital else "any")
    ]
    maps = [window for window in windows if window is not None]
    T_site_world = next(iter(truths.values())).T_site_world
    return Score(
        tuple(position_errors(track) for track in tracks),
        tuple(goal_results(arrivals, truths)),
        tuple(crossed_terrain),
        replace(compare_elevation(maps, T_site_world, scene), blank=len(windows) - len(maps)),
        tuple(unfinished),
    )


def _windows(bus: Bus, truth: Truth, robot: str) -> list[ElevationMap | None]:
    """Return the elevation maps of ``robot`` in the DPM around poses of a path; None for a pose without a
    map.
    """
    lengths_m = path_lengths_m(truth.positions_m[:, :2])
    windows: list[ElevationMap | None] = []
    for row in np.searchsorted(lengths_m, np.arange(0.0, lengths_m[-1], _MAP_EVERY_M)):
        x, y = truth.positions_m[row, :2]
        region = f"circle:{x:.2f},{y:.2f},{_MAP_AROUND_M:g}"
        try:
            windows.append(elevation_window(bus, region, _MAP_CELL_M, robot=robot))
        except ProductNotFoundError:
            windows.append(None)
    return windows

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Runs a mission: starts the system and the simulated rovers, drives, asks, judges, ends everything."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cdff_common.bus import Bus, keys
from cdff_common.clock import NS_PER_S, MissionClock
from cdff_common.errors import CdffError, ProductNotFoundError
from cdff_common.formats.geotiff import read_map
from cdff_common.interfaces.profile import Profile, load_profile
from cdff_common.types import ElevationMap
from cdff_dev.demo.report import Process, Way, elevation_around, processes_under
from cdff_dev.demo.run import Outcome, run_script, wait_for_clock
from cdff_dev.demo.script import Script
from cdff_dev.demo.sharing import relative_errors
from cdff_dev.demo.stage import Stage
from cdff_dev.missions.autonomy import Arrival, Asked, Autonomy
from cdff_dev.missions.orbit import seen_from_orbit, store
from cdff_dev.missions.score import Believed, Score, Truth, believed, located, reached, true_poses
from cdff_dev.missions.script import Mission, check_fits
from cdff_dev.missions.terrain import driven, mapped
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.world import cast_scene, make_world

logger = logging.getLogger(__name__)

#: The world is made before the clock ticks, seconds.
_WORLD_S = 300.0
#: Elevation is compared around places so far apart on the way, within so far, in cells of so much, metres.
_MAP_EVERY_M, _MAP_AROUND_M, _MAP_CELL_M = 60.0, 10.0, 0.2
_CALL_S = 60.0


@dataclass(frozen=True, slots=True, eq=False)
class Result:
    """All that a mission leaves: the score, and what its page shows."""

    mission: Mission
    profile: Profile
    score: Score
    asked: tuple[Asked, ...]
    arrivals: tuple[Arrival, ...]
    outcomes: tuple[Outcome, ...]
    remarks: tuple[str, ...]
    apart: tuple[str, ...]
    ways: tuple[Way, ...]
    ground: ElevationMap | None
    processes: tuple[Process, ...]
    begin_ns: int
    mission_s: float
    took_s: float

    def faults(self) -> list[str]:
        """What is not as the mission demands."""
        unanswered = [f"{o.ask.title}: {'; '.join(o.faults)}" for o in self.outcomes if o.faults]
        return [
            *self.score.faults(self.mission.judged),
            *unanswered,
            *self.apart,
        ]


def run(
    mission: Mission, deploy: Path, stage_at: tuple[str, str, Path | None], seed: int | None, speed: float | None,
    say: Callable[[str], None],
) -> Result:  # fmt: skip
    """Run a mission on ports and in a folder ``stage_at``: the router's endpoint, the HTTP address, the data folder.

    Raises
    ------
    ConfigurationError
        Where the mission does not fit its profile or scenario.
    CdffError
        Where the system does not start, or ends.
    """
    profile_path = deploy / "profiles" / f"{mission.profile}.yaml"
    profile = load_profile(profile_path)
    check_fits(mission, profile, load_scenario(mission.scenario, seed))
    connect, http, data_dir = stage_at
    with (
        Stage(profile, profile_path, connect, http, data_dir) as stage,
        Bus.open(connect, name="mission", wait_s=20.0) as bus,
    ):
        say(f"starting {len(stage.expected)} services of profile {profile.name}; logs in {stage.log_dir}")
        stage.wait_ready(bus)
        if mission.orbital is not None:
            say(f"making what {mission.orbital.robot} saw of scenario {mission.scenario}")
            first = next(iter(mission.robots))
            T_site_odom = profile.robot(first).frame_graph().lookup("site", f"{first}/odom", 0).matrix
            world = make_world(load_scenario(mission.scenario, seed))
            store(bus, seen_from_orbit(world, first, T_site_odom, mission.orbital), mission.orbital.robot)
        truth_log = stage.log_dir.parent / "truth"
        stage.drive(mission.scenario, seed, mission.speed if speed is None else speed, truth_log)
        say(f"making the ground of scenario {mission.scenario}")
        clock, begin_ns = wait_for_clock(bus, stage.check_running, _WORLD_S)
        began_s = time.monotonic()
        rovers, unfinished, outcomes = _drive_all(mission, profile, clock, begin_ns, stage, say)
        mission_s, took_s = (clock.now_ns() - begin_ns) / NS_PER_S, time.monotonic() - began_s
        say(f"{mission_s:.0f} s of mission in {took_s:.0f} s; judging against the truth")
        stage.check_running()
        processes = processes_under(stage.supervisor_pid)
        stage.end_drive()
        truths = true_poses(truth_log, profile, list(mission.robots))
        remarks, apart = _seen(mission, profile, truths, http)
        arrivals = [arrival for rover in rovers for arrival in rover.arrivals]
        found = [believed(profile, robot, http, truth) for robot, truth in truths.items()]
        score = _judged(mission, profile, seed, truths, found, arrivals, unfinished, bus)
        result = Result(
            mission, profile, score, tuple(a for rover in rovers for a in rover.asked), tuple(arrivals),
            tuple(outcomes), tuple(remarks), tuple(apart), tuple(b.way for b in found),
            elevation_around(bus, [b.way for b in found]), tuple(processes), begin_ns, mission_s, took_s,
        )  # fmt: skip
        if result.faults():
            stage.keep = True
            say(f"the logs of every process are kept in {stage.log_dir}")
        return result


def _drive_all(
    mission: Mission, profile: Profile, clock: MissionClock, begin_ns: int, stage: Stage, say: Callable[[str], None]
) -> tuple[list[Autonomy], list[str], list[Outcome]]:
    """Let every rover do its tasks, and ask the mission's own questions meanwhile."""
    stop, unfinished = threading.Event(), list[str]()
    done = {robot: threading.Event() for robot in mission.robots}
    rovers = [
        Autonomy(robot, tasks, mission.guiding, profile, clock, begin_ns, stage.connect, stop, say, done)
        for robot, tasks in mission.robots.items()
    ]

    def drive(rover: Autonomy) -> None:
        try:
            rover.run()
        except CdffError as error:
            unfinished.append(f"{rover.robot}: {error}")
        except Exception as error:  # a bug must not end a rover's tasks unseen
            logger.exception("%s", rover.robot)
            unfinished.append(f"{rover.robot}: {type(error).__name__}: {error}")
        else:
            return
        say(unfinished[-1])

    outcomes: list[Outcome] = []

    def ask() -> None:
        script = Script(profile=mission.profile, requests=mission.requests)
        outcomes.extend(run_script(script, clock, begin_ns, stage.connect, stage.http, lambda _outcome: None))

    threads = [threading.Thread(target=drive, args=(r,), name=f"drive {r.robot}", daemon=True) for r in rovers]
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
        unfinished.append(f"{len(outcomes)} of {len(mission.requests)} requests came to an end")
    return rovers, unfinished, outcomes


def _seen(mission: Mission, profile: Profile, truths: dict[str, Truth], http: str) -> tuple[list[str], list[str]]:
    """Where one robot is as seen from the other, once their maps are merged or time is over: lines, and faults."""
    asked = mission.together
    if asked is None:
        return [], []
    deadline_s = time.monotonic() + asked.wait_s
    while True:
        pairs = [believed(profile, robot, http, truths[robot]) for robot in asked.robots]
        found = [dict(zip(b.way.stamps_ns.tolist(), b.poses, strict=True)) for b in pairs]
        true = [dict(zip(b.truth.stamps_ns.tolist(), b.truth.poses, strict=True)) for b in pairs]
        seen = relative_errors(found, true, asked.within_m)
        line = f"position of {asked.robots[1]} as seen from {asked.robots[0]}: {seen}"
        if seen.pairs and seen.largest_m <= asked.at_most_m:
            return [line], []
        if time.monotonic() > deadline_s:
            return [], [f"{line}, expected at most {asked.at_most_m:g} m"]
        time.sleep(1.0)


def _judged(
    mission: Mission, profile: Profile, seed: int | None, truths: dict[str, Truth], found: Sequence[Believed],
    arrivals: Sequence[Arrival], unfinished: Sequence[str], bus: Bus,
) -> Score:  # fmt: skip
    world = make_world(load_scenario(mission.scenario, seed))
    scene, chassis = cast_scene(world.relief, world.rocks), world.scenario.chassis
    over = []
    for robot, truth in truths.items():
        T_world_base = np.linalg.inv(truth.T_site_world) @ truth.poses
        over.append(driven(robot, T_world_base, scene, chassis.base_height_m, profile.robot(robot).limits))
    first = next(iter(truths.values()))
    # What an orbiter saw is no map of the rover's: with it, each rover's own is asked for.
    held = [_windows(bus, truth, robot if mission.orbital else "any") for robot, truth in truths.items()]
    maps, blank = [window for windows, _ in held for window in windows], sum(count for _, count in held)
    return Score(
        tuple(located(b) for b in found), tuple(reached(arrivals, truths)), tuple(over),
        replace(mapped(maps, first.T_site_world, scene), blank=blank), tuple(unfinished),
    )  # fmt: skip


def _windows(bus: Bus, truth: Truth, robot: str) -> tuple[list[ElevationMap], int]:
    """Elevation of ``robot`` that the DPM holds around places along a way, and at how many of them it holds none."""
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(truth.poses[:, :2, 3], axis=0), axis=1))])
    found, blank = [], 0
    for row in np.searchsorted(s, np.arange(0.0, s[-1], _MAP_EVERY_M)):
        x, y = truth.poses[row, :2, 3]
        asked = {
            "type": "dem", "robot": robot, "frame": "site", "region": f"circle:{x:.2f},{y:.2f},{_MAP_AROUND_M:g}",
            "resolution_m": _MAP_CELL_M, "format": "tif",
        }  # fmt: skip
        try:
            made = read_map(bus.call(keys.dpm_rpc(keys.GROUND, "get"), asked, timeout_s=_CALL_S).payload)
        except ProductNotFoundError:
            blank += 1
            continue
        assert isinstance(made, ElevationMap)  # of a GeoTIFF of elevation
        found.append(made)
    return found, blank

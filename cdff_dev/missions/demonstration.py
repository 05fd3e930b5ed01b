# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The demonstration: it plays a log on a running system, sends requests and assesses the answers."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path

from cdff_common.bus import Bus
from cdff_common.clock import NS_PER_S
from cdff_common.errors import FrameNotFoundError, InputError, UnavailableError
from cdff_common.mission_clock import MissionClock
from cdff_common.progress import progress_of
from cdff_common.resources import resolve
from cdff_dev.missions.map_sharing import assess_shared_map
from cdff_dev.missions.models import upload_model
from cdff_dev.missions.report import Report, elevation_around, resource_usage, write_report
from cdff_dev.missions.requests import Outcome, counts_over_http, run_requests, wait_for_clock
from cdff_dev.missions.script import Script, load_script
from cdff_dev.missions.stage import Stage
from cdff_dev.missions.tracks import Track, estimated_track, read_truth
from cdff_dev.simulate.scenario_files import load_any_scenario
from cdff_dev.simulate.store import simulated_log

PrintLine = Callable[[str], None]


def script_of(name: str) -> Script:
    """Return the script of a scenario, or of ``kitti``; raises ConfigurationError if it has none."""
    return load_script(resolve("demo", name))


def kitti_log(path: Path) -> Path:
    """Return ``path`` if it is a KITTI folder; raises InputError otherwise."""
    if not (path / "image_l_kitti").is_dir() and not (path / "image_0").is_dir():
        raise InputError(
            f"--log {path}: expected a KITTI folder with image_l_kitti or image_0 (use `cdff replay` "
            "for others)"
        )
    return path


def scenario_log(name: str, print_line: PrintLine) -> Path:
    """Return the log of a scenario from the cache; simulate it if it is not there."""
    scenario = load_any_scenario(name)
    print_line(f"simulating {name} (the log is cached)")
    return simulated_log(scenario, progress=progress_of("images and scans"))


def ask_running_system(script: Script, connect: str, http: str, wait_s: float, print_line: PrintLine) -> bool:
    """Send the requests to a system started elsewhere; return True if every answer satisfies its request.

    The mission clock must be published within ``wait_s``.
    """
    with Bus.open(connect, name="demo", wait_s=wait_s) as bus:
        print_line(f"waiting for the mission clock at {connect}")
        clock, start_ns = wait_for_clock(bus, lambda: None, wait_s)
        print_line(f"sending {len(script.requests)} requests over Zenoh, in the role of OG2")
        outcomes = _send_requests(script, clock, start_ns, connect, http, print_line)
        print_line(_answered_line(outcomes))
        return _all_answered(outcomes)


def _send_requests(
    script: Script, clock: MissionClock, start_ns: int, connect: str, http: str, print_line: PrintLine
) -> list[Outcome]:
    """Send the requests, print each outcome on arrival, and return all."""
    return run_requests(
        script.requests, clock, start_ns, connect, http, lambda outcome: print_line(outcome.text)
    )


def demonstrate(
    name: str, script: Script, log: Path, stage: Stage, bus: Bus, report: Path | None, print_line: PrintLine
) -> bool:
    """Play a log on a system that is ready; return True if every answer satisfies its request."""
    for name, mesh in script.models.items():
        model = upload_model(stage.http, name, mesh)
        print_line(
            f"mesh of {name}: {model['triangles']} triangles in {model['frame']}, product {model['id']}"
        )
    stage.play(str(log), script.rate)
    clock, start_ns = wait_for_clock(bus, stage.check_running)
    start_s = time.monotonic()
    print_line(f"playing {log}; sending {len(script.requests)} requests over Zenoh, in the role of OG2")
    outcomes = _send_requests(script, clock, start_ns, stage.connect, stage.http, print_line)
    stage.check_running()
    clock_stopped_s = time.monotonic() - start_s - (clock.now_ns() - start_ns) / NS_PER_S / script.rate
    if clock_stopped_s > 1.0:
        print_line(
            f"this machine is too slow for the mission: the mission clock was stopped for "
            f"{clock_stopped_s:.0f} s in total"
        )
    print_line(f"products available over HTTP at {stage.http}: {counts_over_http(stage.http)}")
    answered_line = _answered_line(outcomes)
    print_line(answered_line)
    remarks, faults = _shared_map_results(script, stage, log, bus)
    for line in (*remarks, *faults):
        print_line(line)
    if report is not None:
        tracks = _tracks(stage, log)
        page = Report(
            title=f"Mission {name}",
            paragraphs=[stage.profile.doc, f"{answered_line}.", *remarks],
            faults=faults,
            tracks=tracks,
            ground=elevation_around(bus, tracks),
            outcomes=outcomes,
            processes=resource_usage(stage.supervisor_pid),
        )
        write_report(report, page)
        print_line(f"the report is in {report}")
    return _all_answered(outcomes) and not faults


def _answered_line(outcomes: Sequence[Outcome]) -> str:
    return f"{sum(not o.faults for o in outcomes)} of {len(outcomes)} requests were answered as asked"


def _all_answered(outcomes: Sequence[Outcome]) -> bool:
    return bool(outcomes) and not any(o.faults for o in outcomes)


def _shared_map_results(script: Script, stage: Stage, log: Path, bus: Bus) -> tuple[list[str], list[str]]:
    """Assess the map that two robots share, if the script requires one; return remarks and faults."""
    if script.sharing is None:
        return [], []
    errors = assess_shared_map(script.sharing, stage.profile, log, bus, stage.http)
    faults = errors.faults(script.sharing)
    remarks = [*errors.lines(), *([] if faults else ["ok   the shared map is within its limits"])]
    return remarks, [f"FAIL the shared map: {'; '.join(faults)}"] if faults else []


def _tracks(stage: Stage, log: Path) -> list[Track]:
    """Return the tracks of the robots that have poses in the DPM."""
    tracks = []
    for robot, truth in read_truth(log, stage.profile.robot_ids).items():
        try:
            tracks.append(estimated_track(stage.profile, robot, stage.http, truth))
        except (UnavailableError, FrameNotFoundError):
            continue
    return tracks

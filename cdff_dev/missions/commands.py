# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff mission`` and ``cdff drive``."""

from __future__ import annotations

import argparse
import json
import signal
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeVar

if TYPE_CHECKING:
    from cdff_common.bus import Bus
    from cdff_dev.missions.stage import Stage


def system_arguments() -> argparse.ArgumentParser:
    """Return a parser with the options that all commands that start a system have in common."""
    system = argparse.ArgumentParser(add_help=False)
    system.add_argument("--http", default="127.0.0.1:8080", metavar="HOST:PORT")
    system.add_argument("--connect", help="endpoint of the router (default: tcp/127.0.0.1:7447)")
    system.add_argument(
        "--data-dir", type=Path, help="folder of the products (default: a new one, removed at the end)"
    )
    system.add_argument(
        "--report", type=Path, metavar="FILE", help="write the results as a page, for example mission.html"
    )
    return system


def register(nouns: Any) -> None:
    """Add ``cdff mission`` and ``cdff drive``."""
    summary = "run a simulated mission with guided rovers or a guided servicer, and score it"
    parser = nouns.add_parser("mission", parents=[system_arguments()], help=summary)
    parser.add_argument(
        "mission", help="a shipped mission (return_to_base), a mission file (.yaml), or 'list'"
    )
    parser.add_argument(
        "--seed", type=int, help="replaces the scenario's seed: different terrain and sensor errors"
    )
    parser.add_argument(
        "--speed", type=float, metavar="X", help="mission seconds per second (default: the mission's)"
    )
    parser.add_argument(
        "--without-lidar",
        action="store_true",
        help="run the variant of the mission whose rover has cameras only",
    )
    parser.add_argument("--json", action="store_true", help="print the score as JSON")
    parser.set_defaults(run=_mission, parser=parser)

    parser = nouns.add_parser(
        "drive", help="simulate rovers or a servicer that execute commands, and publish the mission clock"
    )
    parser.add_argument("scenario", help="a shipped scenario's name or a scenario file (.yaml)")
    parser.add_argument("--seed", type=int, help="replaces the scenario's seed")
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="mission seconds per second (default 1)"
    )
    parser.add_argument(
        "--patience",
        type=float,
        metavar="S",
        help="stop the clock while a DFPC is more than S mission seconds behind",
    )
    parser.add_argument(
        "--truth", type=Path, metavar="LOG", help="write the true poses to this folder, as a log"
    )
    parser.add_argument("--connect", help="the router's endpoint (default: CDFF_CONNECT)")
    parser.set_defaults(run=_drive, parser=parser)


def print_line(text: str) -> None:
    """Print a line without buffering."""
    print(text, flush=True)


def check_outputs(args: argparse.Namespace) -> None:
    """Raise an error if the report or the products cannot be written, before the system is started."""
    from cdff_common.errors import ConfigurationError
    from cdff_common.output import check_file, make_folder

    if args.report is not None:
        check_file(args.report)
    if args.data_dir is not None and any(make_folder(args.data_dir).iterdir()):
        raise ConfigurationError(f"--data-dir {args.data_dir}: contains data; choose an empty folder")


@contextmanager
def running_system(
    args: argparse.Namespace, profile_path: Path, print_line: Callable[[str], None]
) -> Iterator[tuple[Stage, Bus]]:
    """Start the services of a profile and wait until they are ready; the end of the block ends them."""
    from cdff_common.bus import Bus
    from cdff_common.bus.session import DEFAULT_ENDPOINT
    from cdff_common.interfaces.profile import load_profile
    from cdff_dev.missions.stage import Stage

    profile, connect = load_profile(profile_path, complete=True), args.connect or DEFAULT_ENDPOINT
    # Ctrl-C and SIGTERM raise KeyboardInterrupt in the main thread, so that the stage ends its processes.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    with (
        Stage(profile, profile_path, connect, args.http, args.data_dir) as stage,
        Bus.open(connect, name="mission", wait_s=20.0) as bus,
    ):
        print_line(
            f"starting {len(stage.expected)} services of profile {profile.name}; logs in {stage.log_dir}"
        )
        stage.wait_ready(bus, lambda ready, total: print_line(f"  {ready} of {total} ready"))
        yield stage, bus


def keep_logs(stage: Stage, print_line: Callable[[str], None]) -> None:
    """Keep the data folder of a run that failed."""
    stage.keep = True
    print_line(f"the logs of every process are kept in {stage.log_dir}")


def _mission(args: argparse.Namespace) -> int:
    """Run a mission; return 0 if all its limits are met, else 1."""
    from cdff_common.errors import ConfigurationError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.resources import resolve
    from cdff_dev.missions.mission_run import run
    from cdff_dev.missions.orbit.script import is_orbital
    from cdff_dev.missions.report import write_report
    from cdff_dev.missions.script import check_fits, load_mission
    from cdff_dev.shipped.commands import print_shipped
    from cdff_dev.simulate.scenario import load_scenario

    if args.mission == "list":
        return print_shipped("missions", as_json=args.json)
    path = resolve("missions", args.mission)
    if is_orbital(path):
        if args.without_lidar:
            raise ConfigurationError(
                f"--without-lidar: {path.stem} is a mission in orbit, expected one with rovers"
            )
        return _orbit_mission(args, path)
    mission = load_mission(path, without_lidar=args.without_lidar)
    profile_path = _checked_profile_path(args, mission.profile)
    scenario = load_scenario(mission.scenario, args.seed)
    check_fits(mission, load_profile(profile_path), scenario)
    result = _run_on_system(args, profile_path, mission.speed, partial(run, path.stem, mission, scenario))
    score = result.score
    summary = {"guided": mission.limits.guided, "remarks": result.remarks, "score": score.to_dict()}
    _print_result(args, result, (*score.lines(), *result.remarks), {"mission": path.stem, **summary})
    _write_report(args, lambda report: write_report(report, result.report))
    return int(bool(result.faults))


def _orbit_mission(args: argparse.Namespace, path: Path) -> int:
    """Run a mission in orbit; return 0 if all its limits are met, else 1."""
    from cdff_common.errors import ConfigurationError
    from cdff_common.interfaces.profile import load_profile
    from cdff_dev.missions.orbit.mission_run import run
    from cdff_dev.missions.orbit.report import write_report
    from cdff_dev.missions.orbit.script import check_fits, load_orbit_mission
    from cdff_dev.simulate.orbit.scenario import OrbitScenario
    from cdff_dev.simulate.scenario_files import load_any_scenario

    mission = load_orbit_mission(path)
    profile_path = _checked_profile_path(args, mission.profile)
    scenario = load_any_scenario(mission.scenario, args.seed)
    if not isinstance(scenario, OrbitScenario):
        raise ConfigurationError(f"scenario {mission.scenario}: expected one of kind orbit")
    check_fits(mission, load_profile(profile_path), scenario)
    result = _run_on_system(args, profile_path, mission.speed, partial(run, path.stem, mission, scenario))
    _print_result(args, result, result.lines(), {"mission": path.stem, "kind": "orbit", **result.to_dict()})
    _write_report(args, lambda report: write_report(report, result))
    return int(bool(result.faults))


class _Result(Protocol):
    """Result of a mission."""

    @property
    def faults(self) -> list[str]:
        """Tasks that failed, and limits that are not met."""


_ResultT = TypeVar("_ResultT", bound=_Result)


def _checked_profile_path(args: argparse.Namespace, profile: str) -> Path:
    """Return the path of a shipped profile; raises ConfigurationError if an option is not possible."""
    from cdff_common.errors import ConfigurationError
    from cdff_common.resources import deploy_folder

    if args.speed is not None and not 0.0 < args.speed <= 100.0:
        raise ConfigurationError(f"--speed {args.speed:g}: expected above 0, at most 100")
    check_outputs(args)
    return deploy_folder() / "profiles" / f"{profile}.yaml"


def _run_on_system(
    args: argparse.Namespace,
    profile_path: Path,
    mission_speed: float,
    run: Callable[[Stage, Bus, float, Callable[[str], None]], _ResultT],
) -> _ResultT:
    """Start the system of a profile and run a mission on it; if the mission has faults, keep the logs."""
    show = _silent if args.json else print_line
    with running_system(args, profile_path, show) as (stage, bus):
        result = run(stage, bus, mission_speed if args.speed is None else args.speed, show)
        if result.faults:
            keep_logs(stage, show)
    return result


def _print_result(
    args: argparse.Namespace, result: _Result, lines: Iterable[str], summary: dict[str, Any]
) -> None:
    """Print the lines of a result and whether it has faults, or its summary as JSON."""
    if args.json:
        print(json.dumps(summary | {"faults": result.faults}, allow_nan=False))
        return
    conclusion = [f"FAIL {fault}" for fault in result.faults] or ["All limits of the mission are met."]
    for line in (*lines, *conclusion):
        print_line(line)


def _write_report(args: argparse.Namespace, write: Callable[[Path], None]) -> None:
    """Write the report if an option asks for it."""
    if args.report is not None:
        write(args.report)
        if not args.json:
            print_line(f"the report is in {args.report}")


def _silent(text: str) -> None:
    """Print nothing; with ``--json``, the result is the only output."""


def _drive(args: argparse.Namespace) -> int:
    """Simulate the rovers or the servicer of a scenario, which commands move; return the exit code."""
    from cdff_common.bus import Bus
    from cdff_common.output import make_folder
    from cdff_common.process import run_service
    from cdff_dev.logs import LogWriter
    from cdff_dev.missions import drive_commands
    from cdff_dev.missions.driven_log import GrowingLog
    from cdff_dev.missions.orbit import commands as orbit_commands
    from cdff_dev.missions.orbit.guided_log import GuidedLog
    from cdff_dev.play.player import Player
    from cdff_dev.simulate.scenario import Scenario
    from cdff_dev.simulate.scenario_files import load_any_scenario
    from cdff_dev.simulate.world import make_world

    def simulate(stop: threading.Event) -> None:
        scenario = load_any_scenario(args.scenario, args.seed)
        with ExitStack() as stack:
            truth_log = (
                None if args.truth is None else stack.enter_context(LogWriter(make_folder(args.truth)))
            )
            bus = stack.enter_context(Bus.open(args.connect, name="simulator"))
            log: GrowingLog | GuidedLog
            if isinstance(scenario, Scenario):
                log = GrowingLog(make_world(scenario), truth_log)
                drive_commands.serve(bus, log)
            else:
                log = GuidedLog(scenario, truth_log)
                orbit_commands.serve(bus, log)
            player = Player(
                bus,
                log,
                args.speed,
                patience_s=args.patience,
                ready_ns=log.ready_ns,
                ahead_bytes=log.ahead_bytes,
            )
            try:
                player.run(stop)
            finally:
                log.close()

    return run_service("simulator", simulate)

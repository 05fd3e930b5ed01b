# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff demo``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cdff_dev.demo.run import Outcome

#: Where profiles and scripts lie in a checkout; the demonstration runs from one.
DEPLOY = Path(__file__).resolve().parents[2] / "deploy"


def register(nouns: Any) -> None:
    """Add ``cdff demo``."""
    parser = nouns.add_parser(
        "demo", help="run the whole system on recorded data and ask it as an autonomy framework would"
    )
    parser.add_argument(
        "--once", action="store_true", help="stop by itself; exit 0 only if every request was answered as asked"
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument("--scenario", default="rover_traverse", help="simulated scenario (default: rover_traverse)")
    source.add_argument("--log", help="a recorded log, as a KITTI folder, instead of a simulated one")
    parser.add_argument("--http", default="127.0.0.1:8080", metavar="HOST:PORT")
    parser.add_argument("--connect", default="tcp/127.0.0.1:7447", help="endpoint of the router")
    parser.add_argument("--data-dir", help="keep the products there; default: a fresh folder, removed at the end")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write a page of what came out, as mission.html")
    parser.add_argument(
        "--attach", action="store_true", help="ask a system that runs already, as one in containers, and start nothing"
    )
    parser.add_argument(
        "--wait-s", type=float, default=600.0, metavar="S", help="with --attach: how long to wait for the mission clock"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Run the demonstration; 0 when every request was answered as asked, else 1, 130 when it was interrupted."""
    return _ask_running_system(args) if args.attach else _run_system(args)


def _ask_running_system(args: argparse.Namespace) -> int:
    """Ask the script's questions from the moment the mission clock is seen; whoever plays the log is somebody else."""
    from cdff_common.bus import Bus
    from cdff_dev.demo.run import run_script, wait_for_clock
    from cdff_dev.demo.script import load_script

    script = load_script(DEPLOY / "demo" / f"{'kitti' if args.log else args.scenario}.yaml")
    with Bus.open(args.connect, name="demo", wait_s=args.wait_s) as bus:
        _say(f"waiting for the mission clock at {args.connect}")
        clock, begin_ns = wait_for_clock(bus, lambda: None, args.wait_s)
        _say(f"asking {len(script.requests)} questions over Zenoh, as OG2 would")
        return _verdict(run_script(script, clock, begin_ns, args.connect, args.http, _show))


def _verdict(outcomes: Sequence[Outcome]) -> int:
    """Say how many were answered as asked; 0 if all were."""
    answered = sum(not o.faults for o in outcomes)
    _say(f"{answered} of {len(outcomes)} requests were answered as asked")
    return 0 if outcomes and answered == len(outcomes) else 1


def _run_system(args: argparse.Namespace) -> int:
    """Start everything, play, ask, end everything."""
    import signal
    import threading
    import time

    from cdff_common.bus import Bus
    from cdff_common.clock import NS_PER_S
    from cdff_common.errors import ConfigurationError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import check_file, make_folder
    from cdff_dev.demo.run import found_over_http, run_script, wait_for_clock
    from cdff_dev.demo.script import load_script
    from cdff_dev.demo.stage import Stage

    if args.report is not None:
        check_file(args.report)
    data_dir = None if args.data_dir is None else make_folder(Path(args.data_dir))
    if data_dir is not None and (data_dir / "store.sqlite").exists():
        raise ConfigurationError(f"--data-dir {data_dir}: holds products of an earlier run; name an empty folder")
    name, log = _source(args)
    script = load_script(DEPLOY / "demo" / f"{name}.yaml")
    profile_path = DEPLOY / "profiles" / f"{script.profile}.yaml"
    profile = load_profile(profile_path)
    # Both Ctrl-C and SIGTERM interrupt whatever the main thread does, and the stage is left in order.
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.default_int_handler)
    code = 1
    with Stage(profile, profile_path, args.connect, args.http, data_dir) as stage:
        _say(f"starting {len(stage.expected)} services of profile {profile.name}; logs in {stage.log_dir}")
        with Bus.open(args.connect, name="demo", wait_s=20.0) as bus:
            stage.wait_ready(bus, lambda n, total: _say(f"  {n} of {total} ready"))
            stage.play(str(log), script.rate)
            clock, begin_ns = wait_for_clock(bus, stage.check_running)
            began_s = time.monotonic()
            _say(f"playing {log}; asking {len(script.requests)} questions over Zenoh, as OG2 would")
            outcomes = run_script(script, clock, begin_ns, args.connect, args.http, _show)
            stage.check_running()
            held_s = time.monotonic() - began_s - (clock.now_ns() - begin_ns) / NS_PER_S / script.rate
            if held_s > 1.0:
                _say(f"this machine is too slow for the mission: its clock was held for {held_s:.0f} s in all")
            _say(f"found over HTTP at {args.http}: {found_over_http(args.http)}")
            code = _verdict(outcomes)
            remarks: list[str] = []
            if script.sharing is not None:
                from cdff_dev.demo.sharing import settled

                found = settled(script.sharing, profile, log, bus, args.http)
                wrong = found.faults(script.sharing)
                remarks += found.lines()
                remarks.append(
                    "FAIL the shared map: " + "; ".join(wrong) if wrong else "ok   the shared map is as asked"
                )
                code = max(code, int(bool(wrong)))
            for line in remarks:
                _say(line)
            if args.report is not None:
                from cdff_dev.demo.report import elevation_around, processes_under, ways, write_report

                driven = ways(profile, log, args.http)
                ground, used = elevation_around(bus, driven), processes_under(stage.supervisor_pid)
                write_report(args.report, f"Mission {name}", profile, outcomes, remarks, driven, ground, used)
                _say(f"the report is in {args.report}")
            if code:
                stage.keep = True
                _say(f"the logs of every process are kept in {stage.log_dir}")
            if not args.once:
                _say(f"browse http://{args.http} - Ctrl-C ends everything")
                try:
                    threading.Event().wait()
                except KeyboardInterrupt:
                    _say("ending")
    return code


def _source(args: argparse.Namespace) -> tuple[str, Path]:
    """Name of the script and path of the log: recorded, or simulated (and cached) now."""
    from cdff_common.errors import InputError
    from cdff_dev.simulate.commands import progress_line
    from cdff_dev.simulate.scenario import load_scenario
    from cdff_dev.simulate.store import simulated_log

    if args.log is not None:
        path = Path(args.log)
        if not (path / "image_l_kitti").is_dir() and not (path / "image_0").is_dir():
            raise InputError(
                f"--log {path}: expected a KITTI folder with image_l_kitti or image_0 (use `cdff replay` for others)"
            )
        return "kitti", path
    _say(f"simulating {args.scenario} (kept for the next time)")
    return args.scenario, simulated_log(load_scenario(args.scenario), progress=progress_line)


def _say(text: str) -> None:
    print(text, flush=True)


def _show(outcome: Any) -> None:
    mark = "ok  " if not outcome.faults else "FAIL"
    what = outcome.summary if not outcome.faults else "; ".join(outcome.faults)
    print(f"{mark} {outcome.took_s:5.1f} s  {outcome.ask.title}: {what}", flush=True)
    sys.stdout.flush()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff demo``."""

from __future__ import annotations

import argparse
import threading
from pathlib import Path
from typing import Any

from cdff_dev.missions.commands import check_outputs, keep_logs, print_line, running_system, system_arguments


def register(nouns: Any) -> None:
    """Add ``cdff demo``."""
    summary = "run the whole system on recorded data and send it the requests of an autonomy framework"
    parser = nouns.add_parser("demo", parents=[system_arguments()], help=summary)
    parser.add_argument(
        "--once",
        action="store_true",
        help="end after the last request; exit 0 only if every answer satisfies its request",
    )
    source = parser.add_mutually_exclusive_group()
    source.add_argument(
        "--scenario", default="rover_traverse", help="simulated scenario (default: rover_traverse)"
    )
    source.add_argument("--log", type=Path, help="a recorded log (KITTI folder) instead of a simulated one")
    parser.add_argument(
        "--attach",
        action="store_true",
        help="send the requests to a running system, for example in containers, and start nothing; "
        "its endpoint is --connect, else CDFF_CONNECT",
    )
    parser.add_argument(
        "--wait-s",
        type=float,
        default=600.0,
        metavar="S",
        help="with --attach: longest wait for the mission clock",
    )
    parser.set_defaults(run=_demo)


def _demo(args: argparse.Namespace) -> int:
    """Run the demonstration; return 0 if every answer satisfies its request, else 1."""
    from cdff_common.bus.session import endpoint
    from cdff_common.resources import deploy_folder
    from cdff_dev.missions import demonstration

    name = "kitti" if args.log else args.scenario
    script = demonstration.script_of(name)
    if args.attach:
        return int(
            not demonstration.ask_running_system(
                script, endpoint(args.connect), args.http, args.wait_s, print_line=print_line
            )
        )
    check_outputs(args)
    log = (
        demonstration.kitti_log(args.log)
        if args.log
        else demonstration.scenario_log(script.scenario or name, print_line)
    )
    with running_system(args, deploy_folder() / "profiles" / f"{script.profile}.yaml", print_line) as (
        stage,
        bus,
    ):
        succeeded = demonstration.demonstrate(name, script, log, stage, bus, args.report, print_line)
        if not succeeded:
            keep_logs(stage, print_line)
        if not args.once:
            print_line(f"browse http://{args.http} - Ctrl-C ends everything")
            try:
                threading.Event().wait()
            except KeyboardInterrupt:
                print_line("ending")
    return int(not succeeded)

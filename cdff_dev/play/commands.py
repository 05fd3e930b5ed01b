# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff play``."""

from __future__ import annotations

import argparse
import sys
import threading
from typing import Any


def register(nouns: Any) -> None:
    """Add ``cdff play`` to the command line."""
    parser = nouns.add_parser(
        "play",
        help="publish the sensor samples of a log on the bus, with the mission clock",
        description="Publish the sensor samples of a log on the bus, with the mission clock. Keys on a "
        "terminal control it (space or p: pause or resume, s or right: step, + and - or up and down: speed, "
        "< and >: seek by 10 s, l: loop, q: end); programs call cdff/@v1/ground/player/@rpc/"
        "{status|pause|resume|step|speed?x=2|seek?to=30|loop?on=true|stop}, or --http with the same verbs.",
    )
    parser.add_argument("log", metavar="LOG", help="a log file, folder or pattern, or a KITTI folder")
    parser.add_argument(
        "--speed", type=float, default=1.0, metavar="X", help="mission seconds per second (default 1)"
    )
    parser.add_argument(
        "--patience",
        type=float,
        metavar="S",
        help="hold the clock while a DFPC is more than S mission seconds behind",
    )
    parser.add_argument("--robots", nargs="+", metavar="ID", help="robots to play (default: all in the log)")
    parser.add_argument(
        "--wait-for",
        nargs="+",
        default=[],
        metavar="KEYEXPR",
        help="start when these liveliness tokens exist",
    )
    parser.add_argument(
        "--wait-s", type=float, default=60.0, metavar="S", help="longest wait for them (default 60)"
    )
    parser.add_argument(
        "--exit-at-end", action="store_true", help="end with the log instead of keeping the clock running"
    )
    parser.add_argument(
        "--topics", nargs="+", default=[], metavar="PATTERN", help="streams to play, such as '*/navcam.*'"
    )
    parser.add_argument(
        "--start",
        default="0",
        metavar="S",
        help="start S seconds after the first sample, before the end if negative (--start=-10), or at a time",
    )
    parser.add_argument("--duration", type=float, metavar="S", help="play S seconds of the log")
    parser.add_argument("--loop", action="store_true", help="repeat the log; mission time continues")
    parser.add_argument("--pause", action="store_true", help="start paused")
    parser.add_argument(
        "--step",
        action="store_true",
        help="start paused; the space bar publishes the next sample and those of the same time",
    )
    parser.add_argument(
        "--clock",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="publish the mission clock (default)",
    )
    parser.add_argument(
        "--http",
        type=int,
        metavar="PORT",
        help="control by a page and calls on this port of this machine; 0 for a free one",
    )
    parser.add_argument("--connect", help="the router's endpoint (default: CDFF_CONNECT)")
    parser.add_argument(
        "--via",
        nargs="+",
        default=[],
        metavar="ID=ENDPOINT",
        help="robots with a router of their own, on which their samples are published",
    )
    parser.set_defaults(run=_run, parser=parser)


def _run(args: argparse.Namespace) -> int:
    """Play a log on the bus; return the exit code."""
    from contextlib import ExitStack

    from cdff_common.bus import Bus
    from cdff_common.cli import key_values
    from cdff_common.process import run_service
    from cdff_dev.logs.opened import opened as opened_log
    from cdff_dev.play.control import keyboard, serve_control
    from cdff_dev.play.display import shown_progress
    from cdff_dev.play.log_part import LogPart
    from cdff_dev.play.looped_log import LoopedLog
    from cdff_dev.play.player import Player
    from cdff_dev.play.start import wait_for

    endpoint_of = key_values(args.via, "--via", "ID=ENDPOINT, such as mana=tcp/127.0.0.1:7448")

    def body(stop: threading.Event) -> None:
        with ExitStack() as stack:
            opened = stack.enter_context(opened_log(args.log))
            part = LogPart(opened, args.topics, args.start, args.duration)
            if part.left_out:
                names = ", ".join(part.left_out)
                print(f"not played, static poses with stamps outside the log: {names}", file=sys.stderr)
            log = LoopedLog(part, is_repeated=args.loop)
            bus = stack.enter_context(Bus.open(args.connect, name="player"))
            via = {
                robot: stack.enter_context(Bus.open(endpoint, name=f"player of {robot}"))
                for robot, endpoint in endpoint_of.items()
            }
            wait_for(bus, args.wait_for, args.wait_s, stop)
            if not stop.is_set():
                player = Player(
                    bus,
                    log,
                    args.speed,
                    args.robots,
                    args.patience,
                    via=via,
                    is_paused=args.pause or args.step,
                    has_clock=args.clock,
                )
                serve_control(bus, player, stop)
                if args.http is not None:
                    from cdff_dev.play.http_control import served

                    url = stack.enter_context(served(player, stop, args.http))
                    print(f"control at {url}", flush=True)
                with keyboard(player, stop, is_stepping=args.step), shown_progress(player):
                    player.run(stop, stay=not args.exit_at_end)

    return run_service("player", body)

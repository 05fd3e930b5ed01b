# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff calibrate``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.command_table import SUMMARIES
from cdff_dev.calibrate.board_commands import add_board_verbs
from cdff_dev.calibrate.frame_output import add_output_options, send_frames, write_frames
from cdff_dev.calibrate.sensor_commands import add_sensor_verbs

if TYPE_CHECKING:
    from cdff_common.geometry import UncertainTransform
    from cdff_common.interfaces.profile import Robot


def register(nouns: Any) -> None:
    """Add the verbs of ``cdff calibrate``."""
    verbs = nouns.add_parser("calibrate", help=SUMMARIES["calibrate"]).add_subparsers(
        metavar="VERB", required=True
    )
    add_board_verbs(verbs)
    add_sensor_verbs(verbs)
    parser = verbs.add_parser(
        "extrinsics",
        help="mounts of IMUs, lidars and stereo cameras, and scales of the wheels, from one drive",
        description="Compare the motions of each sensor with those of the wheels. Directions that the drive "
        "does not determine are named; they keep the values of the profile. Exit code 3 without a mount.",
    )
    parser.add_argument("log", metavar="LOG", help="log of a drive with wheel odometry")
    parser.add_argument("--profile", metavar="FILE", help="profile with approximate mounts, for comparison")
    parser.add_argument("--robot", metavar="ID", help="robot of the log, if it has several")
    parser.add_argument("--wheels", metavar="STREAM", help="stream of wheel odometry, if there are several")
    parser.add_argument(
        "--stream", metavar="STREAM", action="append", default=[], help="only this sensor; repeatable"
    )
    add_output_options(parser)
    parser.add_argument("--json", action="store_true", help="JSON output")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the mounts; write them to the profile and the DPM if asked."""
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_dev.calibrate.extrinsics import calibrate
    from cdff_dev.logs.opened import opened
    from cdff_dev.replay.wiring import robot_of

    if args.write and args.profile is None:
        raise InputError("--write needs --profile FILE, whose mounts are replaced")
    with opened(args.log) as log:
        types = {n: info.type_name for n, info in log.streams.items() if "/truth." not in n}
        robot = robot_of(types, args.robot)
        known = {} if args.profile is None else _mounts(load_profile(args.profile).robot(robot))
        result = calibrate(log, robot, known, wheels=args.wheels, streams=args.stream)
        end_ns = max(info.t1_ns for info in log.streams.values() if info.count)
    print(json.dumps(result.to_json()) if args.json else "\n".join(result.lines()))
    mounts = {s.frame: s.completed_mount for s in result.sensors if s.completed_mount is not None}
    if args.write and mounts:
        write_frames(Path(args.profile), robot, f"{robot}/base", mounts)
        if not args.json:
            print(f"wrote {', '.join(mounts)} to {args.profile}; the DPM uses them from the next cdff up on")
    if args.dpm and mounts:
        print("\n".join(send_frames(args, f"{result.robot}/base", mounts, end_ns)))
    return 0 if mounts else 3


def _mounts(robot: Robot) -> dict[str, UncertainTransform]:
    """Return the mounts of a profile below the base, by frame."""
    base = f"{robot.id}/base"
    graph = robot.frame_graph()
    return {edge.child: graph.lookup(base, edge.child, 0) for edge in robot.frames if edge.parent == base}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff calibrate``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.cli import add_connect_option
from cdff_common.command_table import SUMMARIES
from cdff_dev.calibrate.board_commands import add_board_verbs

if TYPE_CHECKING:
    from cdff_common.geometry import UncertainTransform
    from cdff_common.interfaces.profile import Robot
    from cdff_dev.calibrate.extrinsics import Calibration

_CALL_S = 10.0


def register(nouns: Any) -> None:
    """Add the verbs of ``cdff calibrate``."""
    verbs = nouns.add_parser("calibrate", help=SUMMARIES["calibrate"]).add_subparsers(
        metavar="VERB", required=True
    )
    add_board_verbs(verbs)
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
    parser.add_argument(
        "--write", action="store_true", help="replace the mounts in the file of --profile; comments are kept"
    )
    parser.add_argument(
        "--dpm", action="store_true", help="add the mounts with their covariances to a running DPM"
    )
    parser.add_argument(
        "--valid-from", metavar="T", help="with --dpm: from this time on (default: the end of the log)"
    )
    parser.add_argument("--json", action="store_true", help="JSON output")
    add_connect_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the mounts; write them to the profile and the DPM if asked."""
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import write_file
    from cdff_dev.calibrate.extrinsics import calibrate
    from cdff_dev.calibrate.profile_edit import with_mounts
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
        path = Path(args.profile)
        write_file(path, with_mounts(path.read_text(encoding="utf-8"), robot, mounts).encode())
        load_profile(path)
        if not args.json:
            print(f"wrote {', '.join(mounts)} to {path}; the DPM takes them at the next cdff up")
    if args.dpm and mounts:
        _send(args, result, end_ns)
    return 0 if mounts else 3


def _mounts(robot: Robot) -> dict[str, UncertainTransform]:
    """Return the mounts of a profile below the base, by frame."""
    base = f"{robot.id}/base"
    graph = robot.frame_graph()
    return {edge.child: graph.lookup(base, edge.child, 0) for edge in robot.frames if edge.parent == base}


def _send(args: argparse.Namespace, result: Calibration, end_ns: int) -> None:
    """Add a revision of each mount to the DPM, valid from a time on."""
    from cdff_common.bus import Bus, keys
    from cdff_common.bus.message import pack
    from cdff_common.clock import parse_stamp

    valid_from_ns = end_ns if args.valid_from is None else parse_stamp(args.valid_from, "--valid-from")
    with Bus.open(args.connect, name="cdff calibrate") as bus:
        for sensor in result.sensors:
            if sensor.completed_mount is None or sensor.completed_mount.covariance is None:
                continue
            body = {
                "frame": sensor.frame,
                "parent": f"{result.robot}/base",
                "T": sensor.completed_mount.matrix.tolist(),
                "covariance": sensor.completed_mount.covariance.tolist(),
                "valid_from_ns": valid_from_ns,
                "producer": "cdff calibrate",
            }
            key = keys.dpm_rpc(keys.GROUND, "frames")
            bus.call(key, payload=pack(body), encoding="application/msgpack", timeout_s=_CALL_S)
            print(f"{sensor.frame}: revision in the DPM, valid from {valid_from_ns} ns")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff new``."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.command_table import SUMMARIES

if TYPE_CHECKING:
    from cdff_dev.new.profile import RobotDraft

#: Kinds of drivers: the modules of ``cdff_dev.new.drivers``.
DRIVERS = ("lidar", "stereo", "imu", "wheels", "joints", "gnss")


def register(nouns: Any) -> None:
    """Add the parsers of ``cdff new``."""
    verbs = nouns.add_parser("new", help=SUMMARIES["new"]).add_subparsers(metavar="KIND", required=True)
    for kind in ("dfn", "dfpc"):
        parser = verbs.add_parser(
            kind, help=f"files of a {kind.upper()}: description, interface, skeleton, test, page"
        )
        parser.add_argument("name", help="name as a class or a folder, LaserFilter or laser_filter")
        parser.add_argument(
            "--root", type=Path, default=None, help="the checkout (default: that of this command)"
        )
        parser.set_defaults(run=run, kind=kind)
    _register_profile(verbs)
    _register_driver(verbs)


def _register_profile(verbs: Any) -> None:
    """Add the parser of ``cdff new profile``."""
    parser = verbs.add_parser(
        "profile",
        help="profile from a log or from questions, with mounts of a URDF and of camera calibrations",
    )
    parser.add_argument("name", metavar="LOG", nargs="?", help="log with the sensors of the robot")
    parser.add_argument("--interactive", action="store_true", help="ask for the sensors instead of a log")
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="file of the profile (default: LOG.yaml in this folder)"
    )
    parser.add_argument(
        "--urdf", metavar="FILE", type=Path, help="URDF of the robot, which is copied next to the profile"
    )
    parser.add_argument(
        "--calibration",
        metavar="FILE",
        type=Path,
        help="OpenCV, ROS or Kalibr calibration: the right camera, and with Kalibr the camera in the IMU",
    )
    parser.add_argument(
        "--picture", metavar="FILE", type=Path, help="draw the frames of the first robot as an SVG file"
    )
    parser.set_defaults(run=write_profile)


def _register_driver(verbs: Any) -> None:
    """Add the parser of ``cdff new driver``."""
    parser = verbs.add_parser(
        "driver",
        help="driver of a sensor, which runs with a simulated device",
        description="Copy the template of a driver. It runs as it is and simulates the device; replace the "
        "class Device by the interface of the device.",
    )
    parser.add_argument("driver", metavar="KIND", choices=DRIVERS, help=", ".join(DRIVERS))
    parser.add_argument(
        "--profile",
        metavar="FILE",
        help="profile with the sensor: the driver takes its frame and stream from it",
    )
    parser.add_argument(
        "--robot", metavar="ID", help="robot id (default: that of --profile, without a profile mana)"
    )
    parser.add_argument(
        "--sensor", metavar="NAME", help="name of the sensor in the profile, if it has several of this kind"
    )
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="file of the driver (default: KIND_driver.py in this folder)"
    )
    parser.set_defaults(run=write_driver)


def write_driver(args: argparse.Namespace) -> int:
    """Copy the template of a driver; raises InputError if the file exists or a name is not valid."""
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import write_file
    from cdff_dev.new.driver import SensorNames, driver_text

    out: Path = args.out or Path(f"{args.driver}_driver.py")
    if out.exists():
        raise InputError(f"{out} exists: name another file with --out")
    if args.profile is None:
        names = SensorNames(args.robot or "mana", args.sensor)
    else:
        names = SensorNames.of_profile(load_profile(args.profile), args.driver, args.robot, args.sensor)
    write_file(out, driver_text(args.driver, names).encode())
    print(f"wrote {out}, which simulates the device")
    print(f"next: python {out} while `cdff up` runs; then replace the class Device")
    return 0


def write_profile(args: argparse.Namespace) -> int:
    """Write a profile from a log or from answers; raises InputError if the file exists."""
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import write_file
    from cdff_dev.new.frames_picture import frames_svg
    from cdff_dev.new.profile import profile_text

    if (args.name is None) != args.interactive:
        raise InputError("cdff new profile: expected a LOG, or --interactive")
    robots, body, stem = _drafts(args)
    out: Path = args.out or Path(f"{stem}.yaml")
    if out.exists():
        raise InputError(f"{out} exists: name another file with --out")
    robots = [_with_imports(args, robot, out) for robot in robots]
    source = args.name or "answers"
    write_file(out, profile_text(robots, source, stem, body).encode())
    profile = load_profile(out)
    names = ", ".join(entry.name for robot in profile.robots for entry in robot.dfpcs) or "none"
    print(f"wrote {out}: robots {', '.join(profile.robot_ids)}; DFPCs {names}")
    if args.picture is not None:
        first = profile.robots[0]
        write_file(args.picture, frames_svg(first.frame_graph(), first.id).encode())
        print(f"wrote {args.picture}: the frames of {first.id}")
    print(f"next: enter mounts and limits in {out}, then cdff check --profile {out}")
    return 0


def _drafts(args: argparse.Namespace) -> tuple[list[RobotDraft], str, str]:
    """Return the robots, the body, and the name of the profile."""
    import re

    from cdff_common.contract.foreign_names import is_anchor
    from cdff_dev.logs.opened import opened
    from cdff_dev.new.profile import robots_of_log
    from cdff_dev.new.questions import ask_robot

    if args.interactive:
        robot, body = ask_robot(input, print)
        return [robot], body, robot.id
    stem = re.sub(r"[^a-z0-9_]+", "_", Path(args.name).resolve().stem.lower()).strip("_") or "robot"
    with opened(args.name) as log:
        body = "earth" if any(map(is_anchor, log.streams)) else "mars"
        return robots_of_log(log, args.name), body, stem


def _with_imports(args: argparse.Namespace, robot: RobotDraft, out: Path) -> RobotDraft:
    """Return a robot with the frames of the URDF and the cameras of the calibration."""
    from dataclasses import replace

    from cdff_common.output import write_file
    from cdff_dev.new.mounts import camera_mounts, read_urdf_file, urdf_frames

    if args.urdf is not None:
        model = read_urdf_file(args.urdf)
        copy = out.with_name(args.urdf.name)
        if copy.resolve() != args.urdf.resolve():
            write_file(copy, args.urdf.read_bytes())
        robot = replace(robot, urdf=copy.name, urdf_frames=urdf_frames(model, robot.id))
    if args.calibration is not None:
        robot = replace(robot, cameras=camera_mounts(args.calibration))
    return robot


def run(args: argparse.Namespace) -> int:
    """Write the files and the reference pages that list them, and print the next steps."""
    from cdff_dev.generate.commands import write_groups
    from cdff_dev.generate.plan import chosen_groups
    from cdff_dev.new.scaffold import scaffold
    from cdff_dev.tree import Tree

    tree = Tree(args.root.resolve()) if args.root else Tree.here()
    paths = scaffold(tree, args.kind, args.name)
    for path in paths:
        print(f"wrote {path.relative_to(tree.root)}")
    if tree.root == Tree.here().root:  # reference pages are made from the installed packages
        importlib.invalidate_caches()
        write_groups(tree, chosen_groups(()))
    print(
        f"next: edit {paths[0].name}, run cdff generate, write the implementation and its test, "
        "run cdff check"
    )
    return 0

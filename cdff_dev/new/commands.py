# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff new``."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any

from cdff_common.command_table import SUMMARIES

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
    parser = verbs.add_parser("profile", help="profile with the sensors of a log")
    parser.add_argument("name", metavar="LOG", help="log with the sensors of the robot")
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="file of the profile (default: LOG.yaml in this folder)"
    )
    parser.set_defaults(run=write_profile)


def _register_driver(verbs: Any) -> None:
    parser = verbs.add_parser(
        "driver",
        help="driver of a sensor, which runs with a simulated device",
        description="Copy the template of a driver. It runs as it is and simulates the device; replace the "
        "class Device by the interface of the device.",
    )
    parser.add_argument("driver", metavar="KIND", choices=DRIVERS, help=", ".join(DRIVERS))
    parser.add_argument("--robot", metavar="ID", default="mana", help="robot id (default: mana)")
    parser.add_argument("--sensor", metavar="NAME", help="name of the sensor in the profile")
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="file of the driver (default: KIND_driver.py in this folder)"
    )
    parser.set_defaults(run=write_driver)


def write_driver(args: argparse.Namespace) -> int:
    """Copy the template of a driver; raises InputError if the file exists or a name is not valid."""
    from cdff_common.errors import InputError
    from cdff_common.output import write_file
    from cdff_dev.new.driver import driver_text

    out: Path = args.out or Path(f"{args.driver}_driver.py")
    if out.exists():
        raise InputError(f"{out} exists: name another file with --out")
    write_file(out, driver_text(args.driver, args.robot, args.sensor).encode())
    print(f"wrote {out}, which simulates the device")
    print(f"next: python {out} while `cdff up` runs; then replace the class Device")
    return 0


def write_profile(args: argparse.Namespace) -> int:
    """Write a profile for the robots of a log; raises InputError if the file exists."""
    import re

    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import write_file
    from cdff_dev.logs.opened import opened
    from cdff_dev.new.profile import profile_text

    stem = re.sub(r"[^a-z0-9_]+", "_", Path(args.name).resolve().stem.lower()).strip("_") or "robot"
    out: Path = args.out or Path(f"{stem}.yaml")
    if out.exists():
        raise InputError(f"{out} exists: name another file with --out")
    with opened(args.name) as log:
        write_file(out, profile_text(log, args.name, stem).encode())
    profile = load_profile(out)
    names = ", ".join(entry.name for robot in profile.robots for entry in robot.dfpcs) or "none"
    print(f"wrote {out}: robots {', '.join(profile.robot_ids)}; DFPCs {names}")
    print(f"next: enter mounts and limits in {out}, then cdff up --profile {out}")
    return 0


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

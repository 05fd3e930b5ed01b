# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff import``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from cdff_common.command_table import SUMMARIES


def register(nouns: Any) -> None:
    """Add the parser of ``cdff import``."""
    verbs = nouns.add_parser("import", help=SUMMARIES["import"]).add_subparsers(metavar="KIND", required=True)
    parser = verbs.add_parser(
        "taste",
        help="profile with a sensor for each function that sends messages of known types",
        description="Write a profile from the interface view of a TASTE project (*_iv.aadl). Its sensors are "
        "the functions that send messages of types of CDFF; enter their mounts and the limits of the rover.",
    )
    parser.add_argument("file", metavar="FILE", type=Path, help="interface view, *_iv.aadl")
    parser.add_argument("--robot", metavar="ID", default="mana", help="robot id (default: mana)")
    parser.add_argument(
        "--out", metavar="PROFILE", type=Path, help="file of the profile (default: FILE.yaml in this folder)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the profile, and print the parameters that became no stream, with the reason."""
    import re

    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.output import write_file
    from cdff_dev.new.profile import profile_text
    from cdff_dev.taste.sensors import robot_of_view
    from cdff_dev.taste.views import read_interface_view

    stem = re.sub(r"[^a-z0-9_]+", "_", args.file.stem.lower()).strip("_") or "robot"
    out: Path = args.out or Path(f"{stem}.yaml")
    if out.exists():
        raise InputError(f"{out} exists: name another file with --out")
    robot, others = robot_of_view(read_interface_view(args.file), args.robot, str(args.file))
    text = profile_text([robot], str(args.file), stem, command="cdff import taste")
    write_file(out, text.encode())
    profile = load_profile(out)
    for line in others:
        print(f"no stream: {line}")
    names = ", ".join(entry.name for entry in profile.robots[0].dfpcs) or "none"
    print(f"wrote {out}: sensors {', '.join(s.name for s in robot.sensors)}; DFPCs {names}")
    print(f"next: enter mounts, rates and limits in {out}, then cdff check --profile {out}")
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff new``."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path
from typing import Any


def register(nouns: Any) -> None:
    """Add the parser of ``cdff new``."""
    parser = nouns.add_parser(
        "new",
        help="write the files of a new DFN or DFPC (description, interface, skeleton, test, page), or a "
        "profile from a log",
    )
    parser.add_argument("kind", choices=["dfn", "dfpc", "profile"])
    parser.add_argument(
        "name", help="name as a class or a folder, LaserFilter or laser_filter; for a profile, the log"
    )
    parser.add_argument(
        "--root", type=Path, default=None, help="the checkout (default: that of this command)"
    )
    parser.add_argument(
        "--out", metavar="FILE", type=Path, help="file of the profile (default: LOG.yaml in this folder)"
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    return write_profile(args) if args.kind == "profile" else run(args)


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

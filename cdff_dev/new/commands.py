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
        "new", help="write the files of a new DFN or DFPC: description, interface, skeleton, test, page"
    )
    parser.add_argument("kind", choices=["dfn", "dfpc"])
    parser.add_argument("name", help="name as a class or a folder: LaserFilter or laser_filter")
    parser.add_argument(
        "--root", type=Path, default=None, help="the checkout (default: that of this command)"
    )
    parser.set_defaults(run=run)


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

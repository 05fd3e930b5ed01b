# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff generate``."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.errors import CdffError

if TYPE_CHECKING:
    from cdff_dev.tree import Tree


def register(nouns: Any) -> None:
    """Add the parser of ``cdff generate``."""
    parser = nouns.add_parser(
        "generate",
        help="generate files from descriptions: types, interfaces, skeletons, reference pages",
        description="Generated files are overwritten. Implementations and tests are written only if they "
        "do not exist.",
    )
    parser.add_argument(
        "group",
        nargs="*",
        help="types, interfaces, skeletons, profile, reference or traceability (default: all)",
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if a file would change")
    parser.add_argument("--dry-run", action="store_true", help="write nothing; show the differences")
    parser.add_argument(
        "--root", type=Path, default=None, help="the checkout (default: that of this command)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the files that differ, or only compare them."""
    from cdff_dev.generate.plan import chosen_groups
    from cdff_dev.generate.skeletons import stale_skeletons
    from cdff_dev.tree import Tree

    tree = Tree(args.root.resolve()) if args.root else Tree.here()
    groups = chosen_groups(args.group)
    due = write_groups(tree, groups, dry_run=args.dry_run, check=args.check)
    stale = stale_skeletons(tree) if "skeletons" in groups else []
    for path in stale:
        print(
            f"stale: {path.relative_to(tree.root)}: it is in no description; rename or delete it",
            file=sys.stderr,
        )
    if args.check and (due or stale):
        raise CdffError(
            f"{due} generated files are not up to date, {len(stale)} skeletons are stale; "
            "run cdff generate and commit the result"
        )
    return 0


def write_groups(tree: Tree, groups: list[str], *, dry_run: bool = False, check: bool = False) -> int:
    """Write the files of each group that differ, or only list them; return their number.

    The artefacts of a group are computed after those of the previous groups are written, since reference
    pages import the skeletons.
    """
    from cdff_dev.generate.artefacts import due
    from cdff_dev.generate.plan import plan

    count = unwritten_skeletons = 0
    for group in groups:
        if group == "reference" and unwritten_skeletons:
            print("reference: not compared, since its pages import the files above", file=sys.stderr)
            continue
        for artefact in due(plan(tree, [group])):
            count += 1
            if dry_run:
                sys.stdout.write(artefact.diff(tree.root))
            elif check:
                print(artefact.path.relative_to(tree.root))
            else:
                artefact.write()
                print(f"wrote {artefact.path.relative_to(tree.root)}")
            unwritten_skeletons += artefact.once and (dry_run or check)
        importlib.invalidate_caches()
    return count

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff generate``."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import Any

from cdff_common.errors import CdffError


def register(nouns: Any) -> None:
    """Add the parser of ``cdff generate``."""
    parser = nouns.add_parser(
        "generate",
        help="write what is made from descriptions: types, interfaces, skeletons, reference pages",
        description="Generated files are overwritten; implementations and tests are written once, where missing.",
    )
    parser.add_argument("group", nargs="*", help="types interfaces skeletons profile reference traceability; none: all")
    parser.add_argument("--check", action="store_true", help="change nothing; exit 1 if something would change")
    parser.add_argument("--dry-run", action="store_true", help="change nothing; show the differences")
    parser.add_argument("--root", type=Path, default=None, help="the checkout (default: where this command lies)")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Generate, or compare with what lies there."""
    from cdff_dev.generate.artefacts import due
    from cdff_dev.generate.plan import plan
    from cdff_dev.generate.tree import Tree

    tree = Tree(args.root.resolve()) if args.root else Tree.here()
    changes = due(plan(tree, args.group))
    for artefact in changes:
        if args.dry_run:
            sys.stdout.write(artefact.diff(tree.root))
        elif args.check:
            print(artefact.path.relative_to(tree.root))
        else:
            artefact.write()
            print(f"wrote {artefact.path.relative_to(tree.root)}")
    if args.check and changes:
        raise CdffError(f"{len(changes)} generated files are not up to date; run cdff generate and commit the result")
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff generate``."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.command_table import SUMMARIES
from cdff_common.errors import CdffError, InputError

if TYPE_CHECKING:
    from cdff_dev.tree import Tree

#: Function that returns the files of a DFPC for another framework.
_FRAMEWORKS = {
    "genom3": "cdff_dev.genom3.component:genom3_files",
    "taste": "cdff_dev.taste.export:taste_files",
}


def register(nouns: Any) -> None:
    """Add the parser of ``cdff generate``."""
    parser = nouns.add_parser(
        "generate",
        help=SUMMARIES["generate"],
        description="Generated files are overwritten. Implementations and tests are written only if they "
        "do not exist.",
    )
    parser.add_argument(
        "group",
        nargs="*",
        help="types, interfaces, skeletons, profile, reference or traceability (default: all); or "
        "genom3 NAME or taste NAME: the interface of a DFPC for that framework",
    )
    parser.add_argument(
        "--out", type=Path, default=None, help="with genom3 and taste: folder of the files (default: here)"
    )
    parser.add_argument("--check", action="store_true", help="write nothing; exit 1 if a file would change")
    parser.add_argument("--dry-run", action="store_true", help="write nothing; show the differences")
    parser.add_argument(
        "--root", type=Path, default=None, help="the checkout (default: that of this command)"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the files that differ, or only compare them."""
    if args.group and args.group[0] in _FRAMEWORKS:
        return write_framework_files(args.group[0], args.group[1:], args)
    if args.out is not None:
        raise InputError(
            f"--out {args.out}: expected genom3 NAME or taste NAME; other files have their place"
        )
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


def write_framework_files(framework: str, names: list[str], args: argparse.Namespace) -> int:
    """Write the interface of DFPCs for another framework, or only compare or show it."""
    from pkgutil import resolve_name

    from cdff_common.interfaces.registry import Registry
    from cdff_common.output import make_folder, storage_errors
    from cdff_dev.generate.artefacts import Artefact, due

    registry = Registry.default()
    if not names:
        known = ", ".join(sorted(registry.dfpcs))
        raise InputError(f"cdff generate {framework}: expected the NAME of a DFPC: {known}")
    folder = (args.out or Path()).resolve()
    files: dict[str, str] = {}
    for name in names:
        files |= resolve_name(_FRAMEWORKS[framework])(registry.dfpc(name))
    changed = due(Artefact(folder / name, text) for name, text in files.items())
    for artefact in changed:
        if args.dry_run:
            sys.stdout.write(artefact.diff(folder))
        elif args.check:
            print(artefact.path)
        else:
            make_folder(folder)
            with storage_errors(artefact.path):
                artefact.write()
            print(f"wrote {artefact.path}")
    if args.check and changed:
        raise CdffError(f"{len(changed)} files differ; run cdff generate {framework} {' '.join(names)}")
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

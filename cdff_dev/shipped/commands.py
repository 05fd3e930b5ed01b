# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff profile list`` and ``cdff scenario list``."""

from __future__ import annotations

import argparse
import json
from typing import Any

from cdff_common.command_table import SUMMARIES

#: Command -> folder of the shipped files.
_KINDS = {"profile": "profiles", "scenario": "simulation"}


def register(nouns: Any) -> None:
    """Add ``cdff profile`` and ``cdff scenario``."""
    for noun in _KINDS:
        verbs = nouns.add_parser(noun, help=SUMMARIES[noun]).add_subparsers(metavar="VERB", required=True)
        listing = verbs.add_parser("list", help=f"names and first sentences of the shipped {noun}s")
        listing.add_argument("--json", action="store_true", help="JSON output")
        listing.set_defaults(run=run_list, kind=_KINDS[noun])


def run_list(args: argparse.Namespace) -> int:
    """Print the names of the shipped files with the first sentence of their descriptions."""
    return print_shipped(args.kind, as_json=args.json)


def print_shipped(kind: str, *, as_json: bool) -> int:
    """Print the shipped files of a kind (a folder of ``deploy``); return 0."""
    from cdff_common.resources import shipped_names, summary_of
    from cdff_common.terminal import print_table

    rows = [(name, summary_of(kind, name)) for name in shipped_names(kind)]
    if as_json:
        print(json.dumps([{"name": name, "summary": summary} for name, summary in rows], indent=1))
    else:
        print_table(("name", "summary"), rows)
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff check``."""

from __future__ import annotations

import argparse
import json
from typing import Any


def register(nouns: Any) -> None:
    """Add the parser of ``cdff check``."""
    parser = nouns.add_parser("check", help="compare descriptions with the code, requirements with the tests")
    parser.add_argument(
        "--verified", action="store_true", help="also check that the last test run verified the requirements"
    )
    parser.add_argument("--json", action="store_true", help="print the faults as a JSON list")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print every fault; return 1 if there is one."""
    from cdff_common.interfaces.registry import Registry
    from cdff_common.progress import elapsed
    from cdff_dev.check import descriptions, requirements
    from cdff_dev.tree import Tree

    root = Tree.here().root
    registry = Registry.default()
    with elapsed("check"):
        faults = descriptions.faults(root, registry) + requirements.faults(root, verified=args.verified)
    if args.json:
        print(json.dumps(faults, indent=1))
    else:
        for fault in faults:
            print(fault)
        print(f"{len(registry.dfns)} DFNs, {len(registry.dfpcs)} DFPCs: {len(faults) or 'no'} faults")
    return 1 if faults else 0

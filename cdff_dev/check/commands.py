# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff check``."""

from __future__ import annotations

import argparse
import json
from typing import Any


def register(nouns: Any) -> None:
    """Add the parser of ``cdff check``."""
    parser = nouns.add_parser(
        "check",
        help="check a profile (--profile), or this checkout: descriptions, requirements",
        description="With --profile: find the mistakes of a profile without driving, all at once, each with "
        "file, line, key, value and expectation. Without: compare the descriptions of this checkout with the "
        "code, and its requirements with the tests. Exit code 1 if there is an error.",
    )
    parser.add_argument(
        "--profile", metavar="FILE", help="profile to check, e.g. deploy/profiles/rover_traverse.yaml"
    )
    parser.add_argument(
        "--log", metavar="LOG", help="with --profile: also compare streams, types, rates and frames of a log"
    )
    parser.add_argument(
        "--verified", action="store_true", help="also check that the last test run verified the requirements"
    )
    parser.add_argument("--json", action="store_true", help="print the faults as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print every fault; return 1 if there is one."""
    from cdff_common.errors import InputError
    from cdff_common.interfaces.registry import Registry
    from cdff_common.progress import elapsed

    if args.profile is not None:
        from cdff_dev.check.profile import report

        if args.verified:
            raise InputError("--verified is for a checkout, not for --profile")
        result = report(args.profile, args.log)
        print(json.dumps(result.to_json(), indent=1) if args.json else "\n".join(result.lines()))
        return 1 if result.has_errors else 0
    if args.log is not None:
        raise InputError("--log needs --profile FILE, with which the log is compared")
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

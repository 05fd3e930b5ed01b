# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff eval registration EST TRUTH``."""

from __future__ import annotations

import argparse
import json
from typing import Any


def add(verbs: Any) -> None:
    """Add the parser of the verb."""
    parser = verbs.add_parser(
        "registration",
        help="poses found between clouds against their truth",
        description="Recall within gates with its 95 % interval, errors, normalised squared errors of the stated "
        "covariances, and counts of matches. EST is an outputs.json of `cdff run`, a file with one pose, a TUM or "
        "KITTI file or log with many, or a folder of one such entry (a file, or a folder with outputs.json) a pair; "
        "TRUTH is the same with an entry of the same name for each pair. A pair of TRUTH without a pose in EST counts "
        "as refused; a pair whose TRUTH entry is an empty file has no answer, and any answer to it is wrong.",
    )
    parser.add_argument("estimate", metavar="EST")
    parser.add_argument("truth", metavar="TRUTH")
    parser.add_argument("--est-stream", metavar="NAME", help="stream of EST where that is a log of several")
    parser.add_argument("--truth-stream", metavar="NAME", help="stream of TRUTH where that is a log of several")
    parser.add_argument("--port", metavar="NAME", help="output port of an outputs.json with several poses")
    parser.add_argument(
        "--gate",
        metavar="M,DEG",
        action="append",
        help="what counts as right: metres and degrees (default 0.3,3 and 0.02,0.1); again for more",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    from cdff_common.errors import InputError
    from cdff_common.json_form import jsonable
    from cdff_dev.registration import compare, read_pairs, table

    gates = []
    for text in args.gate or ("0.3,3", "0.02,0.1"):
        try:
            metres, degrees = (float(word) for word in text.split(","))
        except ValueError as error:
            raise InputError(f"--gate {text}: expected metres and degrees with a comma between, as 0.3,3") from error
        gates.append((metres, degrees))
    estimate = read_pairs(args.estimate, args.est_stream, args.port)
    figures = compare(estimate, read_pairs(args.truth, args.truth_stream, args.port), gates)
    print(json.dumps(jsonable(figures), indent=1) if args.json else table(figures))
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff eval trajectory EST REF``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any


def add(verbs: Any) -> None:
    """Add the parser of the verb."""
    parser = verbs.add_parser(
        "trajectory",
        help="an estimated trajectory against a reference",
        description="Absolute and relative errors, drift by distance, and whether covariances are honest. A trajectory "
        "is a TUM file, a KITTI pose file (12 numbers a line; 100 ms apart) or a log with poses.",
    )
    parser.add_argument("estimate", metavar="EST")
    parser.add_argument("reference", metavar="REF")
    parser.add_argument("--est-stream", metavar="NAME", help="stream of EST where that is a log of several")
    parser.add_argument("--ref-stream", metavar="NAME", help="stream of REF where that is a log of several")
    parser.add_argument(
        "--align",
        choices=("se3", "yaw", "sim3", "origin", "none"),
        default="se3",
        help="what of EST is fitted to REF: all of a rigid motion (default), translation and heading, a motion and a "
        "scale, the first pose, nothing",
    )
    parser.add_argument("--max-difference-s", type=float, default=0.01, metavar="S", help="stamps that belong together")
    parser.add_argument("--delta", type=float, default=1.0, metavar="D", help="of relative errors (default 1)")
    parser.add_argument("--delta-unit", choices=("frames", "m"), default="frames", help="unit of --delta")
    parser.add_argument("--all-pairs", action="store_true", help="relative errors of overlapping pairs too")
    parser.add_argument(
        "--segments-m",
        metavar="LENGTHS",
        help="lengths of the drift by distance, as 100,200; default: KITTI's 100..800 where the way is long enough, "
        "else 5,10,20,50,100",
    )
    parser.add_argument("--plot", type=Path, metavar="FILE", help="draw both from above and the errors: SVG")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    from cdff_common.errors import InputError
    from cdff_common.json_form import jsonable
    from cdff_dev.trajectory.compare import Comparison, compare
    from cdff_dev.trajectory.read import read_track
    from cdff_dev.trajectory.report import table

    try:
        segments = None if args.segments_m is None else [float(w) for w in args.segments_m.split(",")]
    except ValueError as error:
        raise InputError(f"--segments-m {args.segments_m}: expected metres with commas between") from error
    found: Comparison = compare(
        read_track(args.estimate, args.est_stream),
        read_track(args.reference, args.ref_stream),
        align=args.align,
        max_difference_s=args.max_difference_s,
        delta=args.delta,
        delta_unit=args.delta_unit,
        all_pairs=args.all_pairs,
        segments_m=segments,
    )
    if args.plot is not None:
        from cdff_common.output import check_file, write_file
        from cdff_dev.trajectory.plot import drawn

        check_file(args.plot)
        write_file(args.plot, drawn(found).encode())
    print(json.dumps(jsonable(found.figures), indent=1) if args.json else table(found.figures))
    return 0

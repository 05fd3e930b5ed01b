# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff eval dem MAP TRUTH``."""

from __future__ import annotations

import argparse
import json
from typing import Any


def add(verbs: Any) -> None:
    """Add the parser of the verb."""
    parser = verbs.add_parser(
        "dem",
        help="an elevation map against the true terrain",
        description="Bias, RMSE, NMAD, LE90, completeness, error of the slope, coverage of the 90 % intervals, and the "
        "horizontal and vertical shift between the two. A map is a GeoTIFF (bands as the DPM's, or one of heights) "
        "or a log with elevation maps, whose last is taken; both are in one frame.",
    )
    parser.add_argument("map", metavar="MAP")
    parser.add_argument("truth", metavar="TRUTH")
    parser.add_argument("--map-stream", metavar="NAME", help="stream of MAP where that is a log of several")
    parser.add_argument("--truth-stream", metavar="NAME", help="stream of TRUTH where that is a log of several")
    parser.add_argument(
        "--remove-shift", action="store_true", help="move and tilt the map as a whole to where it fits best first"
    )
    parser.add_argument("--least-count", type=int, default=1, metavar="N", help="leave out cells of fewer measurements")
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    from cdff_common.json_form import jsonable
    from cdff_dev.elevation.compare import compare, table
    from cdff_dev.elevation.read import read_dem

    dem = read_dem(args.map, args.map_stream)
    truth = read_dem(args.truth, args.truth_stream, frame=dem.frame)
    figures = compare(dem, truth, remove_shift=args.remove_shift, least_count=args.least_count)
    print(json.dumps(jsonable(figures), indent=1) if args.json else table(figures))
    return 0

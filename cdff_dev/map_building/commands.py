# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff map``."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from cdff_common.command_table import SUMMARIES


def register(nouns: Any) -> None:
    """Add ``cdff map build``."""
    verbs = nouns.add_parser("map", help=SUMMARIES["map"]).add_subparsers(metavar="VERB", required=True)
    parser = verbs.add_parser(
        "build",
        help="map of keyframes from images with known poses",
        description="Build the map of visual_localisation from a log of stereo pairs, or of colour and depth "
        "images, with the poses of the camera or of the robot. Its frame is that of the poses.",
    )
    parser.add_argument("log", metavar="PATH", help="log file, folder or pattern of any known format")
    parser.add_argument("--out", metavar="MAP", type=Path, required=True, help="file of the map (npz)")
    parser.add_argument("--calibration", metavar="FILE", type=Path, help="calibration, for logs without one")
    parser.add_argument("--sigma-m", type=float, default=0.003, metavar="M", help="accuracy of the positions")
    parser.add_argument(
        "--sigma-deg", type=float, default=0.1, metavar="DEG", help="accuracy of the rotations"
    )
    parser.add_argument(
        "--depth-offset-m",
        type=float,
        nargs=3,
        default=(0.0, 0.0, 0.0),
        metavar=("X", "Y", "Z"),
        help="position of the depth camera in the frame of the colour camera (default: 0 0 0)",
    )
    parser.add_argument("--first", type=float, metavar="S", help="only from this time of the log on, seconds")
    parser.add_argument("--last", type=float, metavar="S", help="only up to this time of the log, seconds")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Write the map and print its size."""
    from cdff_common.formats.visual_map import write_visual_map
    from cdff_common.output import write_file
    from cdff_dev.logs.opened import opened
    from cdff_dev.map_building.build import MapOptions, build_map

    options = MapOptions(
        sigma_m=args.sigma_m,
        sigma_deg=args.sigma_deg,
        depth_offset_m=tuple(args.depth_offset_m),
        first_s=args.first,
        last_s=args.last,
    )
    with opened(args.log, args.calibration) as log:
        result = build_map(log, options)
    write_file(args.out, write_visual_map(result))
    points = len(result.points.positions)
    summary = {"keyframes": len(result.points.counts), "points": points, "frame": result.frame}
    text = f"{args.out}: {summary['keyframes']} keyframes with {points} points in {result.frame}"
    print(json.dumps(summary, sort_keys=True) if args.json else text)
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff slam`` and ``cdff vo``."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cdff_dev.slam.methods import Method


def register(nouns: Any) -> None:
    """Add ``cdff slam`` and ``cdff vo``."""
    _add(nouns, "slam", "trajectory and map from the lidar of a log, in one command")
    _add(nouns, "vo", "trajectory from the stereo camera of a log, in one command")


def _add(nouns: Any, name: str, summary: str) -> None:
    parser = nouns.add_parser(
        name,
        help=summary,
        description=f"{summary.capitalize()}. Writes trajectory.tum, trajectory_kitti.txt, run.json and "
        "pictures; with true poses in the log also their comparison. cdff slam also writes map.ply and "
        "graph.g2o.",
    )
    parser.add_argument(
        "log", metavar="PATH", help="log file, folder or pattern of files of any known format"
    )
    parser.add_argument(
        "--out", metavar="DIR", type=Path, help=f"folder for the results (default: {name}_PATH)"
    )
    parser.add_argument(
        "--calibration", metavar="FILE", type=Path, help="calibration of the cameras, for logs without one"
    )
    parser.add_argument("--profile", metavar="FILE", help="profile with frames and parameters of the robot")
    parser.add_argument("--stream", metavar="NAME", help="stream of the sensor, if the log has several")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=partial(_run, name))


def _run(name: str, args: argparse.Namespace) -> int:
    from cdff_dev.slam.methods import METHODS

    method: Method = METHODS[name]
    return _estimate(method, args)


def _estimate(method: Method, args: argparse.Namespace) -> int:
    from contextlib import closing

    from cdff_dev.logs import open_log
    from cdff_dev.slam.estimation import estimate
    from cdff_dev.slam.files import write_files
    from cdff_dev.slam.report import summary_text

    out: Path = args.out or Path(f"{method.name}_{Path(args.log).resolve().name}")
    with closing(open_log(args.log, args.calibration)) as log:
        estimation = estimate(method, log, args.log, args.profile, args.stream)
    summary = write_files(estimation, out)
    print(json.dumps(summary, sort_keys=True) if args.json else summary_text(summary, out))
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff slam``, ``cdff vo`` and ``cdff dem``."""

from __future__ import annotations

import argparse
import json
from functools import partial
from pathlib import Path
from typing import Any


def register(nouns: Any) -> None:
    """Add ``cdff slam``, ``cdff vo`` and ``cdff dem``."""
    _add(nouns, "slam", "trajectory and map from the lidar or camera of a log, in one command")
    vo = _add(nouns, "vo", "trajectory and map from the stereo camera of a log, in one command")
    vo.add_argument(
        "--map",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="compute map.ply from the disparities of some of the pairs (default)",
    )
    dem = _add(nouns, "dem", "elevation map from the lidar or stereo camera of a log, in one command")
    dem.add_argument(
        "--resolution-m", metavar="M", type=float, default=0.1, help="edge of a cell (default: 0.1 m)"
    )


def _add(nouns: Any, name: str, summary: str) -> argparse.ArgumentParser:
    """Add the parser of a command."""
    parser: argparse.ArgumentParser = nouns.add_parser(
        name,
        help=summary,
        description=f"{summary.capitalize()}. Writes trajectory.tum, trajectory_kitti.txt, run.json, "
        "graph.g2o, report.html, outputs.msg and pictures; with true poses in the log also their comparison. "
        "cdff slam and cdff vo also map.ply, cdff slam from a camera map.npz; cdff dem also dem.tif and "
        "dem.png. Without a profile, cdff dem assumes that the sensor is level at the start.",
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
    parser.add_argument("--view", action="store_true", help="then show the log and the result; see cdff view")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    parser.set_defaults(run=partial(_run, name))
    return parser


def _run(name: str, args: argparse.Namespace) -> int:
    """Estimate trajectory and map of a log, and write the results; return the exit code."""
    from contextlib import suppress

    from cdff_common.extras import import_extra
    from cdff_common.output import make_folder
    from cdff_dev.logs.opened import opened
    from cdff_dev.slam.elevation import map_elevation
    from cdff_dev.slam.estimation import estimate
    from cdff_dev.slam.files import write_files
    from cdff_dev.slam.methods import method_for
    from cdff_dev.slam.report import summary_text
    from cdff_dev.slam.stereo_map import map_stereo

    if args.view:
        import_extra("rerun")  # a missing viewer is reported before the work
    out: Path = args.out or _default_folder(name, Path(args.log).resolve())
    make_folder(out)  # a folder that cannot be written is reported before the work
    try:
        with opened(args.log, args.calibration) as log:
            method = method_for(name, log, args.stream)
            estimation = estimate(method, log, args.log, args.profile, args.stream)
            elevation = stereo_map = None
            if name == "dem":
                elevation = map_elevation(estimation, log, args.resolution_m, args.profile)
            elif name == "vo" and args.map:
                stereo_map = map_stereo(estimation, log, args.profile)
    except BaseException:
        with suppress(OSError):  # a folder with earlier results stays
            out.rmdir()
        raise
    summary = write_files(estimation, out, elevation, stereo_map)
    print(json.dumps(summary, sort_keys=True) if args.json else summary_text(summary, out))
    if args.view:
        _view(args, out)
    return 0


def _view(args: argparse.Namespace, out: Path) -> None:
    from cdff_common.interfaces.profile import load_profile
    from cdff_dev.view.outputs import rerun_viewer
    from cdff_dev.view.show import Selection, show_logs

    profile = None if args.profile is None else load_profile(args.profile)
    paths = [(args.log, args.calibration), (str(out), None)]
    print(show_logs(rerun_viewer(), paths, Selection(profile=profile)))


def _default_folder(name: str, log: Path) -> Path:
    """Return a folder named like the command and the log; for a pattern, like the folder of its files."""
    named = log.parent if any(c in log.name for c in "*?[") else log
    return Path(f"{name}_{named.name}")

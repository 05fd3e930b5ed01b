# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff eval``."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

#: Results of a comparison, and the function that formats them as a table.
Results = tuple[Mapping[str, Any], Callable[[Any], str]]


def register(nouns: Any) -> None:
    """Add ``cdff eval`` with its verbs."""
    parser = nouns.add_parser("eval", help="compare results with ground truth, or two runs with each other")
    parser.set_defaults(help_parser=parser)  # prints its help if no verb is given
    verbs = parser.add_subparsers(metavar="VERB")
    for add_parser, compare in (
        (_add_dem, _dem),
        (_add_registration, _registration),
        (_add_trajectory, _trajectory),
        (_add_compare, _compare),
    ):
        verb = add_parser(verbs)
        verb.add_argument("--json", action="store_true", help="print JSON")
        verb.set_defaults(run=partial(_run, compare))


def _run(compare: Callable[[argparse.Namespace], Results], args: argparse.Namespace) -> int:
    from cdff_common.json_form import jsonable
    from cdff_common.progress import elapsed

    with elapsed("comparison"):
        results, table = compare(args)
    print(json.dumps(jsonable(results), indent=1) if args.json else table(results))
    return 0


def _add_plot(parser: argparse.ArgumentParser, content: str) -> None:
    parser.add_argument("--plot", type=Path, metavar="FILE", help=f"draw {content}: .png or .svg")


def _check_plot(path: Path | None) -> None:
    """Raise an error if a plot cannot be written, before the comparison."""
    if path is not None:
        from cdff_common.plots import check_plot_file

        check_plot_file(path)


def _write_plot(path: Path | None, draw: Callable[[], Any]) -> None:
    if path is not None:
        from cdff_common.plots import write_figure

        write_figure(path, draw())


def _add_stream(parser: argparse.ArgumentParser, option: str, log: str) -> None:
    parser.add_argument(
        option, metavar="NAME", help=f"stream to read, if {log} is a log with several streams"
    )


def _add_dem(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of ``cdff eval dem``."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "dem",
        help="compare an elevation map with the true terrain",
        description="Prints bias, RMSE, NMAD, LE90, completeness, slope error, fraction of true heights in "
        "the 90 % intervals, and the horizontal and vertical shift between the two. A map is a GeoTIFF "
        "(bands of the DPM, or one band of heights) or a log, of which the last elevation map is used; both "
        "maps are in the same frame.",
    )
    parser.add_argument("map", metavar="MAP")
    parser.add_argument("truth", metavar="TRUTH")
    _add_stream(parser, "--map-stream", "MAP")
    _add_stream(parser, "--truth-stream", "TRUTH")
    parser.add_argument(
        "--remove-shift",
        action="store_true",
        help="first translate and tilt the whole map to its best fit",
    )
    parser.add_argument(
        "--least-count", type=int, default=1, metavar="N", help="ignore cells with fewer measurements"
    )
    _add_plot(parser, "both maps and the errors")
    return parser


def _dem(args: argparse.Namespace) -> Results:
    """Compare an elevation map with the truth; return the results and the function that prints them."""
    from cdff_dev.compare.elevation.compare import accuracy_of, errors_of, table
    from cdff_dev.compare.elevation.plot import draw
    from cdff_dev.compare.elevation.read import read_dem

    _check_plot(args.plot)
    dem = read_dem(args.map, args.map_stream)
    truth = read_dem(args.truth, args.truth_stream, frame=dem.frame)
    errors = errors_of(dem, truth, remove_shift=args.remove_shift, least_count=args.least_count)
    results = accuracy_of(errors)
    _write_plot(args.plot, partial(draw, errors, results))
    return results, table


def _add_compare(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of ``cdff eval compare``."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "compare",
        help="compare two runs",
        description="Prints the differences of two folders of cdff slam, vo, dem, run or replay: "
        "configuration, quality, cost, trajectories and maps (B is the reference, without alignment), and "
        "answers to requests.",
    )
    parser.add_argument("a", metavar="A", type=Path, help="folder of a run")
    parser.add_argument("b", metavar="B", type=Path, help="folder of another run")
    return parser


def _compare(args: argparse.Namespace) -> Results:
    from cdff_dev.compare.runs import compare_runs, table

    return compare_runs(args.a, args.b), table


def _add_registration(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of ``cdff eval registration``."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "registration",
        help="compare estimated poses between clouds with the true ones",
        description="Prints recall within error limits with its 95 % interval, errors, NEES of the stated "
        "covariances, and numbers of matches. EST is an outputs.json of `cdff run`, a file with one pose, a "
        "TUM or KITTI file or log with many, or a folder with one entry per pair: a file, or a folder with "
        "outputs.json. TRUTH has the same form; entries are paired by name. A pair of TRUTH without a pose "
        "in EST counts as refused. If the entry in TRUTH is an empty file, no pose is correct: "
        "any pose in EST counts as a false accept.",
    )
    parser.add_argument("estimate", metavar="EST")
    parser.add_argument("truth", metavar="TRUTH")
    _add_stream(parser, "--est-stream", "EST")
    _add_stream(parser, "--truth-stream", "TRUTH")
    parser.add_argument("--port", metavar="NAME", help="output port of an outputs.json with several poses")
    parser.add_argument(
        "--gate",
        metavar="M,DEG",
        action="append",
        help="largest error of a correct pose, metres and degrees (default 0.3,3 and 0.02,0.1); may be "
        "repeated",
    )
    _add_plot(parser, "the errors of each pair")
    return parser


def _registration(args: argparse.Namespace) -> Results:
    """Compare poses between clouds; return the results and the function that prints them."""
    from cdff_common.errors import InputError
    from cdff_dev.compare.registration import compare, read_pairs, table
    from cdff_dev.compare.registration.plot import draw

    _check_plot(args.plot)
    gates = []
    for text in args.gate or ("0.3,3", "0.02,0.1"):
        try:
            metres, degrees = (float(word) for word in text.split(","))
        except ValueError as error:
            raise InputError(
                f"--gate {text}: expected metres and degrees separated by a comma, such as 0.3,3"
            ) from error
        gates.append((metres, degrees))
    estimate = read_pairs(args.estimate, args.est_stream, args.port)
    truth = read_pairs(args.truth, args.truth_stream, args.port)
    results = compare(estimate, truth, gates)
    _write_plot(args.plot, partial(draw, estimate, truth, gates))
    return results, table


def _add_trajectory(verbs: Any) -> argparse.ArgumentParser:
    """Add the parser of ``cdff eval trajectory``."""
    parser: argparse.ArgumentParser = verbs.add_parser(
        "trajectory",
        help="compare an estimated trajectory with a reference",
        description="Prints absolute and relative errors, drift by path length, and the NEES of the "
        "covariances. A trajectory is a TUM file, a KITTI pose file (12 numbers per line; 100 ms between "
        "poses), a CSV file of EuRoC or a log with poses (bag, MCAP, …). Poses whose stamps are repeated "
        "or not in order are dropped and counted.",
    )
    parser.add_argument("estimate", metavar="EST")
    parser.add_argument("reference", metavar="REF")
    _add_stream(parser, "--est-stream", "EST")
    _add_stream(parser, "--ref-stream", "REF")
    parser.add_argument(
        "--ref-frame",
        metavar="NAME",
        help="frame of EST, such as the camera, if REF is a log of another frame and states the place of the "
        "frame on the robot",
    )
    parser.add_argument(
        "--align",
        choices=("se3", "yaw", "sim3", "origin", "none"),
        default="se3",
        help="alignment of EST to REF: se3 = rotation and translation (default), yaw = translation and "
        "heading, sim3 = with scale, origin = first poses coincide, none",
    )
    parser.add_argument(
        "--max-difference-s",
        type=float,
        default=0.01,
        metavar="S",
        help="largest difference of matched time stamps",
    )
    parser.add_argument(
        "--delta",
        type=float,
        default=1.0,
        metavar="D",
        help="distance between the two poses of a relative error (default 1)",
    )
    parser.add_argument("--delta-unit", choices=("frames", "m"), default="frames", help="unit of --delta")
    parser.add_argument(
        "--all-pairs", action="store_true", help="use overlapping pairs too for relative errors"
    )
    parser.add_argument(
        "--segments-m",
        metavar="LENGTHS",
        help="segment lengths for the drift, m, such as 100,200; default: 100 to 800 as KITTI if the path is "
        "longer than 100 m, else 5,10,20,50,100",
    )
    _add_plot(parser, "both paths and the errors by axis")
    return parser


def _trajectory(args: argparse.Namespace) -> Results:
    """Compare two trajectories; return the results and the function that prints them."""
    from cdff_common.errors import InputError
    from cdff_dev.compare.trajectory.compare import compare
    from cdff_dev.compare.trajectory.plot import draw
    from cdff_dev.compare.trajectory.read import read_track
    from cdff_dev.compare.trajectory.report import table

    try:
        segments = None if args.segments_m is None else [float(w) for w in args.segments_m.split(",")]
    except ValueError as error:
        raise InputError(f"--segments-m {args.segments_m}: expected metres separated by commas") from error
    _check_plot(args.plot)
    comparison = compare(
        read_track(args.estimate, args.est_stream),
        read_track(args.reference, args.ref_stream, args.ref_frame),
        align=args.align,
        max_difference_s=args.max_difference_s,
        delta=args.delta,
        delta_unit=args.delta_unit,
        all_pairs=args.all_pairs,
        segments_m=segments,
    )
    _write_plot(args.plot, partial(draw, comparison))
    return comparison.results, table

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Verbs of ``cdff log`` that convert, compare and export logs."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from cdff_dev.logs.sinks import ROS2, SCHEMAS


def register_conversions(verbs: Any) -> None:
    """Add the parsers of ``cdff log convert``, ``diff`` and ``export``."""
    convert = verbs.add_parser(
        "convert",
        help="write a log in another format",
        description="Writes the streams of a log of any format to a new log. Content that the new log cannot "
        "hold is listed with its number of samples.",
    )
    convert.add_argument("source", metavar="SRC", help="log of any format")
    convert.add_argument(
        "target",
        metavar="DST",
        type=Path,
        help="NAME.msg (InFuse), NAME.bag (ROS 1), NAME.mcap (MCAP), or a name without suffix for the folder "
        "of a ROS 2 bag",
    )
    convert.add_argument(
        "--schemas",
        choices=SCHEMAS,
        default=ROS2,
        help="messages of an MCAP file: of ROS 2, or of Foxglove's schemas (protobuf or JSON) and of ROS 2 "
        "where these lack the type (default: ros2)",
    )
    _add_calibration(convert)
    convert.add_argument(
        "--map", metavar="FILE", type=Path, help="YAML with topics and frames; cdff log info --map prints one"
    )
    convert.add_argument("--streams", metavar="NAME", nargs="+", help="only these streams")
    add_span(convert)
    convert.add_argument("--json", action="store_true", help="print the report as JSON")
    convert.set_defaults(run=_convert)

    diff = verbs.add_parser(
        "diff", help="compare two logs of any format: streams, counts and values; exit code 1 if different"
    )
    diff.add_argument("first", metavar="LOG")
    diff.add_argument("second", metavar="LOG")
    diff.add_argument(
        "--rounding", action="store_true", help="numbers are equal within 1e-9, as after a conversion"
    )
    diff.add_argument("--json", action="store_true", help="print JSON")
    diff.set_defaults(run=_diff)

    export = verbs.add_parser(
        "export", help="write a stream as TUM (poses), PLY or PCD (clouds), PNG (images) or CSV (numbers)"
    )
    export.add_argument("log", metavar="LOG", help="log of any format")
    export.add_argument("stream", metavar="STREAM")
    _add_calibration(export)
    export.add_argument(
        "--out",
        metavar="PATH",
        type=Path,
        required=True,
        help="NAME.tum, NAME.csv, or a folder for clouds (NAME.pcd for PCD) and images",
    )
    export.set_defaults(run=_export)


def add_span(parser: argparse.ArgumentParser) -> None:
    """Add the options of a part of a log: its start and length."""
    parser.add_argument(
        "--start", metavar="SECONDS", type=float, default=0.0, help="after the first sample (default: 0)"
    )
    parser.add_argument("--duration", metavar="SECONDS", type=float, help="length (default: to the end)")


def _add_calibration(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--calibration", metavar="FILE", type=Path, help="calibration of the cameras, for logs without one"
    )


def _convert(args: argparse.Namespace) -> int:
    """Convert a log and print a report; return the exit code."""
    from cdff_dev.logs.conversion import TimeSpan, convert_log
    from cdff_dev.logs.mapping import read_map
    from cdff_dev.logs.opened import opened

    mapping = None if args.map is None else read_map(args.map)
    with opened(args.source, args.calibration) as log:
        report = convert_log(
            log,
            args.target,
            mapping=mapping,
            streams=args.streams,
            span=TimeSpan(args.start, args.duration),
            schemas=args.schemas,
        )
    for line in report.lines():
        print(line, file=sys.stderr)
    if args.json:
        print(json.dumps(report.to_json()))
    else:
        total = sum(report.written.values())
        print(f"{args.target}: {total} samples of {len(report.written)} streams")
    return 0


def _diff(args: argparse.Namespace) -> int:
    """Print the differences of two logs; return 1 if there are any."""
    from cdff_common.progress import elapsed
    from cdff_dev.logs.differences import EXACT, ROUNDING
    from cdff_dev.logs.log_comparison import log_differences
    from cdff_dev.logs.opened import opened

    with (
        opened(args.first) as first,
        opened(args.second) as second,
        elapsed("comparison"),
    ):
        lines = log_differences(first, second, ROUNDING if args.rounding else EXACT)
    if args.json:
        print(json.dumps({"differences": lines}))
    else:
        print("\n".join(lines) if lines else "equal")
    return 1 if lines else 0


def _export(args: argparse.Namespace) -> int:
    """Write the samples of a stream as files; return the exit code."""
    from cdff_common.progress import elapsed
    from cdff_dev.logs.export import export_stream
    from cdff_dev.logs.opened import opened

    with opened(args.log, args.calibration) as log, elapsed("export"):
        count = export_stream(log, args.stream, args.out)
    print(f"{args.out}: {count} samples of {args.stream}")
    return 0

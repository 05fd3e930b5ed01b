# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff run``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.cli import add_plot_option

if TYPE_CHECKING:
    from cdff_dev.run.execution import Result


def register(nouns: Any) -> None:
    """Add ``cdff run``."""
    parser = nouns.add_parser(
        "run",
        help="run one DFN or DFPC once, on files",
        description="Run a DFN or DFPC once on files and write its outputs. The types of the ports "
        "decide how files are read; formats are recognised by content. 'cdff dfn|dfpc show NAME' lists "
        "ports and parameters.",
        epilog="exit codes: 0 for OK and DEGRADED, 3 for FAILED (outputs.json is written, without a value)",
    )
    parser.add_argument(
        "name", help="folder, class name or alias, such as icp_localisation or Registration3D"
    )
    parser.add_argument(
        "inputs",
        nargs="*",
        metavar="PORT=FILE",
        help="an input; IMAGE,CAMERA for an image or depth image with its camera, LEFT,RIGHT,CAMERA for a "
        "stereo pair, where CAMERA is a calibration file of OpenCV, Kalibr or KITTI; a number for a numeric "
        "port; ports of models may be given several times, and those of the sensors of a DFPC for files in "
        "the order of time, or as a pattern: 'cloud=scans/*.ply'",
    )
    parser.add_argument("--implementation", help="implementation (default: the first in the description)")
    parser.add_argument("--config", metavar="FILE", help="YAML or JSON mapping of parameters")
    parser.add_argument(
        "--set",
        action="append",
        nargs="+",
        default=[],
        metavar="KEY=VALUE",
        dest="settings",
        help="a parameter, which precedes --config; dots address nested keys: register_fine.tukey=2.5",
    )
    parser.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for outputs.json and the output files; - for outputs.json with the whole values on "
        "standard output, without files",
    )
    add_plot_option(parser)
    parser.add_argument("--json", action="store_true", help="print outputs.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read the inputs, run, and write the outputs; return 0, or 3 if the algorithm refused."""
    from cdff_common.cli import repeated_key_values
    from cdff_common.output import is_standard_output
    from cdff_common.progress import elapsed
    from cdff_dev.run.execution import execute
    from cdff_dev.run.outputs import drawn_values, output_document, write_outputs
    from cdff_dev.run.parameters import parameters

    if args.plot is not None:
        from cdff_common.plots import check_plot_file, figure_of, write_figure

        check_plot_file(args.plot)
    out = Path(args.out)
    config = parameters(args.config, [item for group in args.settings for item in group])
    inputs = repeated_key_values(args.inputs, "input", "PORT=FILE")
    with elapsed(args.name):
        result = execute(args.name, inputs, config, args.implementation)
    to_stdout = is_standard_output(out)
    report = output_document(result) if to_stdout else write_outputs(result, out)
    failed = report["quality"]["status"] == "FAILED"
    if args.plot is not None and not failed:
        write_figure(args.plot, figure_of(drawn_values(result)))
    if to_stdout or args.json:
        print(json.dumps(report, indent=1))
    else:
        _print_report(result, report, out)
    return 3 if failed else 0


def _print_report(result: Result, report: dict[str, Any], folder: Path) -> None:
    """Print quality and cost to standard error; files, and values in words, to standard output."""
    from cdff_dev.run.outputs import value_text

    quality = report["quality"]
    print(f"{result.name}: {quality['status']} in {report['cpu_s']:.2f} s of CPU", file=sys.stderr)
    for reason in quality["reasons"]:
        print(f"  {reason}", file=sys.stderr)
    for port, entry in report["outputs"].items():
        if "file" in entry:
            print(folder / entry["file"])
        elif "value" in entry:
            print(f"{port} = {json.dumps(entry['value'])}")
        for line in value_text(result, port):
            print(f"  {line}")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff run``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any


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
        help="an input; IMAGE,CAMERA for an image with its camera, LEFT,RIGHT,CAMERA for a stereo "
        "pair, where CAMERA is a calibration file of OpenCV, Kalibr or KITTI; a number for a numeric "
        "port",
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
        "--out", required=True, metavar="DIR", help="folder for outputs.json and the output files"
    )
    parser.add_argument("--json", action="store_true", help="print outputs.json")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Read the inputs, run, and write the outputs; return 0, or 3 if the algorithm refused."""
    from cdff_common.cli import key_values
    from cdff_dev.run.execution import execute
    from cdff_dev.run.outputs import write_outputs
    from cdff_dev.run.parameters import parameters

    config = parameters(args.config, [item for group in args.settings for item in group])
    result = execute(args.name, key_values(args.inputs, "input", "PORT=FILE"), config, args.implementation)
    report = write_outputs(result, Path(args.out))
    if args.json:
        print(json.dumps(report, indent=1))
    else:
        quality = report["quality"]
        print(f"{result.name}: {quality['status']} in {report['cpu_s']:.2f} s of CPU", file=sys.stderr)
        for reason in quality["reasons"]:
            print(f"  {reason}", file=sys.stderr)
        for port, entry in report["outputs"].items():
            if "file" in entry:
                print(Path(args.out) / entry["file"])
            elif "value" in entry:
                print(f"{port} = {json.dumps(entry['value'])}")
    return 3 if report["quality"]["status"] == "FAILED" else 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff doctor``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cdff_dev.doctor.checks import Finding

_COLOURS = {"ok": "green", "warning": "yellow", "error": "red"}
_MARKS = {"ok": "ok     ", "warning": "warning", "error": "ERROR  "}


def register(nouns: Any) -> None:
    """Add the parser of ``cdff doctor``."""
    parser = nouns.add_parser(
        "doctor", help="check that this machine can run the system, and advise on problems"
    )
    parser.add_argument(
        "--connect",
        default=None,
        help="endpoint of the router (default: CDFF_CONNECT, or tcp/127.0.0.1:7447)",
    )
    parser.add_argument("--http", default="127.0.0.1:8080", help="host:port of the HTTP server of the DPM")
    parser.add_argument(
        "--data-dir", default=None, help="data folder (default: CDFF_DATA_DIR, or ~/.local/share/cdff)"
    )
    parser.add_argument("--json", action="store_true", help="print the findings as a JSON list")
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print every finding; return 1 if one is an error."""
    from cdff_common.bus.session import endpoint
    from cdff_common.process import data_dir_of
    from cdff_common.terminal import styled
    from cdff_dev.doctor.checks import examine

    findings = []
    for finding in examine(endpoint(args.connect), args.http, data_dir_of(args.data_dir)):
        findings.append(finding)
        if not args.json:
            advice = f"  ({finding.advice})" if finding.advice else ""
            mark = styled(_MARKS[finding.state], _COLOURS[finding.state], sys.stdout)
            print(f"{mark} {finding.check:18} {finding.detail}{advice}", flush=True)
    print(json.dumps([asdict(f) for f in findings], indent=1) if args.json else conclusion(findings))
    return 1 if any(f.state == "error" for f in findings) else 0


def conclusion(findings: Sequence[Finding]) -> str:
    """Return one line: whether the machine can run the system, and the checks that need attention."""
    errors = [f.check for f in findings if f.state == "error"]
    warnings = [f.check for f in findings if f.state == "warning"]
    if errors:
        line = f"this machine cannot run the system: {', '.join(errors)}"
    else:
        line = "this machine can run the system"
    return line + (f"; warnings: {', '.join(warnings)}" if warnings else "")

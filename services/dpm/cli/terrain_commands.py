# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm terrain surface|viewshed|difference|contours|statistics``; options are those of the models."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

_HELP = {
    "surface": "slope with its error, aspect and roughness",
    "viewshed": "visibility from a point",
    "difference": "change of the heights between the captures before and after a time",
    "contours": "contour lines as GeoJSON",
    "statistics": "statistics of a region, and volumes",
}


class _AnalysisParser(argparse.ArgumentParser):
    """Parser of an analysis; its options are added at the first use: the models take 0.2 s to import."""

    analysis = ""

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse the arguments."""
        self._add_options()
        return super().parse_known_args(args, namespace)

    def format_help(self) -> str:
        """Return the help."""
        self._add_options()
        return super().format_help()

    def _add_options(self) -> None:
        from cdff_common.contract.queries import TERRAIN_ANALYSES

        if not self.analysis:
            return
        for name, field in TERRAIN_ANALYSES[self.analysis].model_fields.items():
            text = (field.description or "").replace("%", "%%")
            self.add_argument(f"--{name.replace('_', '-')}", required=field.is_required(), help=text)
        self.analysis = ""


def register(verbs: Any) -> None:
    """Add ``cdff dpm terrain``."""
    parser = verbs.add_parser("terrain", help="analyses of the heights of a region")
    analyses = parser.add_subparsers(metavar="ANALYSIS", required=True, parser_class=_AnalysisParser)
    for name, text in _HELP.items():
        analysis = analyses.add_parser(name, help=text)
        analysis.analysis = name
        analysis.add_argument("--out", type=Path, required=name != "statistics", help="file to write")
        analysis.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
        analysis.add_argument("--json", action="store_true")
        analysis.set_defaults(run=run_terrain, of_terrain=name)


def run_terrain(args: argparse.Namespace) -> int:
    """Write the result, or print the statistics."""
    from cdff_common.client import Client
    from cdff_common.contract.queries import TERRAIN_ANALYSES
    from cdff_common.output import check_file, write_file

    fields = TERRAIN_ANALYSES[args.of_terrain].model_fields
    parameters = {name: getattr(args, name) for name in fields if getattr(args, name) is not None}
    if "format" in fields:
        parameters.setdefault("format", "tif")
    if args.out is not None:
        check_file(args.out)
    with Client(args.connect, name="cdff dpm") as client:
        result = client.terrain(args.of_terrain, **parameters)
    if args.out is None:
        print(json.dumps(result.document, indent=None if args.json else 2))
        return 0
    write_file(args.out, result.data)
    origin = {name: result.metadata[name] for name in ("coverage", "resolution_m", "frames_revision")}
    line = {"file": str(args.out), "bytes": len(result.data), **origin}
    text = f"{args.out}: {len(result.data)} bytes, {origin['coverage']:.0%} of the region observed"
    print(json.dumps(line) if args.json else text)
    return 0

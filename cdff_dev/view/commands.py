# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff view``."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any


def register(nouns: Any) -> None:
    """Add ``cdff view``."""
    parser = nouns.add_parser(
        "view",
        help="show logs, runs or the running system in a viewer",
        description="Show frames, clouds, images, maps, trajectories with 95 % ellipsoids, pose graphs, "
        "detections, quality and timing over mission time, in the viewer Rerun (extra view). All servers "
        "listen on this machine only.",
    )
    parser.add_argument("logs", nargs="*", metavar="PATH", help="logs and folders of runs, shown together")
    parser.add_argument("--live", action="store_true", help="show the products of the running system")
    parser.add_argument("--connect", help="with --live: endpoint of the router; CDFF_CONNECT")
    parser.add_argument("--duration", type=float, metavar="S", help="with --live: end after S seconds")
    destinations = parser.add_mutually_exclusive_group()
    destinations.add_argument(
        "--save", metavar="FILE", type=Path, help="write NAME.rrd (Rerun) or NAME.mcap (Foxglove)"
    )
    destinations.add_argument(
        "--web", action="store_true", help="serve the viewer to the browser of this machine"
    )
    destinations.add_argument(
        "--foxglove", action="store_true", help="serve Foxglove's WebSocket protocol on this machine"
    )
    parser.add_argument("--port", type=int, metavar="N", help="with --foxglove: TCP port (default: 8765)")
    parser.add_argument(
        "--layout",
        metavar="FILE",
        type=Path,
        help="with Foxglove: also write its layout, to be imported there",
    )
    parser.add_argument(
        "--derive",
        action="append",
        choices=("disparity", "features"),
        help="compute this from the stereo pairs or images and show it over them; may be repeated",
    )
    parser.add_argument("--profile", metavar="FILE", help="profile with the fixed frames of the robots")
    parser.add_argument("--stream", action="append", metavar="NAME", help="only this stream; may be repeated")
    parser.add_argument("--t0", metavar="TIME", help="earliest stamp: nanoseconds or RFC 3339")
    parser.add_argument("--t1", metavar="TIME", help="latest stamp")
    parser.add_argument(
        "--calibration", metavar="FILE", type=Path, help="calibration of the cameras, for logs without one"
    )
    parser.add_argument(
        "--model",
        action="append",
        default=[],
        metavar="FILE",
        help="mesh of a body (OBJ, PLY, STL, GLB, VRML), drawn at the poses of {name}/body and at detections, "
        "and over the images; may be repeated",
    )
    parser.add_argument(
        "--unit", choices=("m", "mm", "cm", "km"), default="m", help="unit of the meshes (default: m)"
    )
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    """Show logs or a live mission; return the exit code."""
    from cdff_common.clock import parse_stamp
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_dev.view.outputs import output_of
    from cdff_dev.view.show import Selection, show_live, show_logs

    if args.live == bool(args.logs):
        raise InputError("name logs or folders of runs; or --live without any")
    if args.port is not None and not args.foxglove:
        raise InputError(f"--port {args.port}: only with --foxglove")
    selection = Selection(
        streams=args.stream,
        t0_ns=None if args.t0 is None else parse_stamp(args.t0, "--t0"),
        t1_ns=None if args.t1 is None else parse_stamp(args.t1, "--t1"),
        profile=None if args.profile is None else load_profile(args.profile),
        derived=args.derive or (),
        models=tuple(args.model),
        unit=args.unit,
    )
    if args.foxglove and not args.live:
        return _play(args, selection)
    output = output_of(args)
    if args.live:
        print(show_live(output, args.connect, selection, args.duration))
    else:
        print(show_logs(output, [(path, args.calibration) for path in args.logs], selection))
    output.wait()
    return 0


def _play(args: argparse.Namespace, selection: Any) -> int:
    """Serve logs to Foxglove from a temporary MCAP file: a server sends to the clients it has."""
    import tempfile

    from cdff_common.output import check_file
    from cdff_dev.view.outputs import FOXGLOVE_PORT, mcap_file, play_in_foxglove
    from cdff_dev.view.show import show_logs

    port = args.port or FOXGLOVE_PORT
    if args.layout is not None:
        check_file(args.layout)
    with tempfile.TemporaryDirectory(prefix="cdff-view-") as folder:
        path = Path(folder) / "scene.mcap"
        output = mcap_file(path, args.layout, f"ws://127.0.0.1:{port}, until Ctrl-C")
        text = show_logs(output, [(log, args.calibration) for log in args.logs], selection)
        output.wait()
        print(text, flush=True)
        play_in_foxglove(path, port)
    return 0

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff world``: show, compare and export the frames and items at a mission time."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from cdff_common.world import World

_AT = "mission time: nanoseconds, RFC 3339, or +SECONDS from the start of the log (default: the newest pose)"


def register(nouns: Any) -> None:
    """Add ``cdff world``."""
    parser = nouns.add_parser("world", help="frames with covariances, and items, at a mission time")
    parser.set_defaults(help_parser=parser)
    verbs = parser.add_subparsers(metavar="VERB")

    show = verbs.add_parser("show", help="print the frames and items, or the transform between two frames")
    _add_source(show)
    show.add_argument("--at", metavar="TIME", help=_AT)
    show.add_argument(
        "--transform", nargs=2, metavar=("PARENT", "CHILD"), help="print only this transform, with sigmas"
    )
    show.add_argument("--type", metavar="NAME", help="only items of this ASN.1 type")
    show.add_argument("--frame", metavar="FRAME", help="only items in this frame")
    show.add_argument("--json", action="store_true", help="print JSON")
    show.set_defaults(run=_show)

    diff = verbs.add_parser("diff", help="print the changes between two times")
    _add_source(diff)
    diff.add_argument("--at", nargs=2, required=True, metavar="TIME", help=_AT)
    diff.add_argument("--json", action="store_true", help="print JSON")
    diff.set_defaults(run=_diff)

    export = verbs.add_parser("export", help="write the world to a file")
    _add_source(export)
    export.add_argument("--at", metavar="TIME", help=_AT)
    export.add_argument(
        "--out",
        required=True,
        metavar="FILE",
        type=Path,
        help="NAME.world (all frames and items), NAME.glb (glTF: frames, clouds, maps, meshes) or NAME.gpkg "
        "(GeoPackage: positions and outlines)",
    )
    export.add_argument(
        "--root", metavar="FRAME", help="frame of the coordinates (default: the root with most frames)"
    )
    export.set_defaults(run=_export)


def _add_source(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", nargs="?", metavar="LOG", help="log, folder of a run, or NAME.world")
    parser.add_argument("--live", action="store_true", help="use the DPM of the running system")
    parser.add_argument("--connect", help="with --live: endpoint of the router; CDFF_CONNECT")
    parser.add_argument("--profile", metavar="FILE", help="profile with the fixed frames of the robots")
    parser.add_argument(
        "--calibration", metavar="FILE", type=Path, help="calibration of the cameras, for logs without one"
    )


def _worlds(args: argparse.Namespace, times: list[str | None]) -> list[World]:
    """Return the world of the arguments at each time."""
    from cdff_common.clock import parse_stamp
    from cdff_common.errors import InputError
    from cdff_common.interfaces.profile import load_profile
    from cdff_common.progress import elapsed
    from cdff_common.world import read_world
    from cdff_dev.logs.opened import opened
    from cdff_dev.world.from_log import time_of, world_of_log

    if args.live == (args.log is not None):
        raise InputError("name a log, a folder of a run or a file NAME.world; or --live without one")
    if args.live:
        from cdff_common.client import Client

        with Client(args.connect, name="cdff world") as client:
            return [client.world(None if t is None else parse_stamp(t, "--at")) for t in times]
    path = Path(args.log)
    if path.suffix == ".world" and path.is_file():
        if any(t is not None for t in times):
            raise InputError(f"--at: {path} holds one time only")
        return [read_world(path.read_bytes()) for _ in times]
    profile = None if args.profile is None else load_profile(args.profile)
    with opened(args.log, args.calibration) as log, elapsed("reading the log"):
        return [world_of_log(log, time_of(log, t, args.log), profile) for t in times]


def _show(args: argparse.Namespace) -> int:
    """Print the world at a time, or a transform of it; return the exit code."""
    from dataclasses import replace

    from cdff_common.json_form import jsonable
    from cdff_common.types import TransformWithCovariance
    from cdff_common.value_text import value_lines
    from cdff_dev.world.report import world_text, world_to_dict

    (world,) = _worlds(args, [args.at])
    if args.transform:
        parent, child = args.transform
        T = world.transform(parent, child)
        if args.json:
            print(
                json.dumps(
                    jsonable(
                        {
                            "stamp_ns": world.stamp_ns,
                            "parent": parent,
                            "child": child,
                            "T": T.matrix,
                            "covariance": T.covariance,
                        }
                    )
                )
            )
        else:
            pose = TransformWithCovariance.from_transform(
                T, parent=parent, child=child, stamp_ns=world.stamp_ns
            )
            print("\n".join(value_lines(pose)))
        return 0
    world = replace(world, items=world.items_of(args.type, args.frame))
    print(json.dumps(jsonable(world_to_dict(world))) if args.json else world_text(world))
    return 0


def _diff(args: argparse.Namespace) -> int:
    from cdff_common.json_form import jsonable
    from cdff_dev.world.report import difference_text

    first, second = _worlds(args, args.at)
    changes = first.difference_to(second)
    print(json.dumps(jsonable(changes.to_dict())) if args.json else difference_text(changes))
    return 0


def _export(args: argparse.Namespace) -> int:
    """Write the world as a file, GLB or GeoPackage; return the exit code."""
    from cdff_common.output import check_file, format_of_suffix, write_file
    from cdff_common.world import write_world
    from cdff_dev.world.export import most_connected_root

    form = format_of_suffix(args.out, ("world", "glb", "gpkg"), "world")
    check_file(args.out)
    (world,) = _worlds(args, [args.at])
    root = args.root or most_connected_root(world)
    if form == "world":
        write_file(args.out, write_world(world))
    elif form == "glb":
        from cdff_dev.world.gltf import write_glb

        write_file(args.out, write_glb(world, root))
    else:
        from cdff_dev.world.geopackage import write_geopackage

        write_geopackage(world, root, args.out)
    return 0

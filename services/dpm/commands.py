# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm search|get|put|rm|stat|retention|verify|backup|restore|export``: what a DPM holds, whether it is whole."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any


def register(nouns: Any) -> None:
    """Add ``cdff dpm``."""
    parser = nouns.add_parser("dpm", help="search, fetch and delete products of a running DPM")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    search = verbs.add_parser("search", help="metadata of products, newest first")
    search.add_argument("--type", help="pose trajectory pointcloud dem navigation_map …")
    search.add_argument("--robot")
    search.add_argument("--dfpc")
    search.add_argument("--region", help="bbox: box: circle: polygon: path: near:, metres")
    search.add_argument("--frame", help="frame of the region; default: site")
    search.add_argument("--t0", help="captured at or after: nanoseconds or RFC 3339")
    search.add_argument("--t1", help="captured at or before")
    search.add_argument("--tag", help="carries this tag; all of several with commas")
    search.add_argument("--quality", help="numbers of the quality, as inliers>=30,rmse_px<0.5")
    search.add_argument("--order", choices=("newest", "oldest", "nearest"))
    search.add_argument("--point", help="with --order nearest: x,y in the frame; default: the region's centre")
    search.add_argument("--as-of", help="what the store knew then: nanoseconds or RFC 3339")
    search.add_argument("--frames-revision", type=int, help="state of the frame tree to place products by")
    search.add_argument("--limit", type=int, default=20)
    search.set_defaults(run=run_search)
    get = verbs.add_parser("get", help="the payload of a product")
    get.add_argument("id")
    get.add_argument("--format", help="uper ber xer msgpack tif ply png tum …; default: as it is stored")
    get.add_argument("--out", type=Path, required=True)
    get.set_defaults(run=run_get)
    put = verbs.add_parser("put", help="insert a file as a product")
    put.add_argument(
        "file", type=Path, help="ply pcd las laz bin tif json tum g2o png, or a payload: uper ber xer msgpack"
    )
    put.add_argument("--robot", required=True)
    put.add_argument("--type", help="pose trajectory pointcloud dem …; default: what the suffix stands for")
    put.add_argument("--dfpc", default="manual", help="who made it; default: manual")
    put.add_argument("--port", help="default: the type")
    put.add_argument("--frame", help="of a file that names none; default: site")
    put.add_argument("-t", "--t", help="when it was captured: nanoseconds or RFC 3339; default: the file's, else now")
    put.set_defaults(run=run_put)
    remove = verbs.add_parser("rm", help="delete a product")
    remove.add_argument("id")
    remove.set_defaults(run=run_remove)
    stat = verbs.add_parser("stat", help="how much it holds")
    stat.set_defaults(run=run_stat)
    verify = verbs.add_parser("verify", help="read everything in a store whose DPM is stopped, and say what is wrong")
    verify.add_argument("--data-dir", type=Path, help="default: CDFF_DATA_DIR, ~/.local/share/cdff")
    verify.add_argument("--json", action="store_true")
    verify.set_defaults(run=run_verify)
    retention = verbs.add_parser("retention", help="what the profile's rules let go, and why; --apply deletes it")
    how = retention.add_mutually_exclusive_group()
    how.add_argument("--dry-run", action="store_true", help="only say so (the default)")
    how.add_argument("--apply", action="store_true", help="delete what may go")
    retention.set_defaults(run=run_retention)
    backup = verbs.add_parser("backup", help="copy a store on this machine, while its DPM runs and writes")
    backup.add_argument("out", type=Path, help="directory to be made")
    backup.add_argument("--data-dir", help="default: CDFF_DATA_DIR, ~/.local/share/cdff")
    backup.add_argument("--json", action="store_true")
    backup.set_defaults(run=run_backup)
    restore = verbs.add_parser("restore", help="make a store of a backup, and verify it")
    restore.add_argument("backup", type=Path)
    restore.add_argument("--data-dir", help="new or empty; default: CDFF_DATA_DIR, ~/.local/share/cdff")
    restore.add_argument("--json", action="store_true")
    restore.set_defaults(run=run_restore)
    export = verbs.add_parser("export", help="what a search finds as files: COG, PLY, LAZ, GeoJSON, TUM, g2o")
    _export_arguments(export)
    for verb in (search, get, put, remove, stat, retention, export):
        verb.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
        verb.add_argument("--json", action="store_true")


def _export_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="folder, or one file: tif ply las laz pcd tum geojson g2o")
    parser.add_argument("--type", help="pose trajectory pointcloud dem navigation_map …; several with commas")
    parser.add_argument("--robot")
    parser.add_argument("--dfpc")
    parser.add_argument("--region", help="bbox: box: circle: polygon: path: near:, metres")
    parser.add_argument("--frame", help="frame of the region, and of one file; default: site")
    parser.add_argument("--t0", help="captured at or after: nanoseconds or RFC 3339")
    parser.add_argument("--t1", help="captured at or before")
    parser.add_argument("--tag")
    parser.add_argument("--as-of", help="what the store knew then")
    parser.add_argument("--format", help="of each file in a folder, where the type has it")
    parser.add_argument("--resolution-m", type=float, help="cells of a tif; coarser data come as they are")
    parser.add_argument("--points", type=int, help="at most so many in one cloud")
    parser.set_defaults(run=run_export)


def run_export(args: argparse.Namespace) -> int:
    """Write files and say which."""
    from cdff_common.bus import Bus
    from services.dpm.export import export

    with Bus.open(args.connect, name="cdff dpm") as bus:
        files = export(bus, args)
    if args.json:
        print(json.dumps({"files": files}))
        return 0
    for file in files:
        print(f"{file['file']}: {file['bytes']} bytes, {file['products']} products")
    return 0


_SEARCHED = (
    "robot", "dfpc", "region", "frame", "t0", "t1", "tag", "quality", "order", "point", "as_of", "frames_revision",
    "limit",
)  # fmt: skip


def run_search(args: argparse.Namespace) -> int:
    """Print one line per product."""
    from cdff_common.client import Client
    from cdff_common.clock import format_stamp
    from cdff_common.json_form import jsonable

    wishes = {name: getattr(args, name) for name in _SEARCHED}
    with Client(args.connect, name="cdff dpm") as client:
        items = client.search(args.type, **{k: v for k, v in wishes.items() if v is not None})
    if args.json:
        print(json.dumps(jsonable(items)))
        return 0
    for item in items:
        when = format_stamp(int(item["t1_ns"]))
        status = item["quality"]["status"]
        print(
            f"{item['id']}  {item['product']:15} {item['robot']:10} {when}  {item['frame']}  {item['size']} B  {status}"
        )
    if not items:
        print("nothing found")
    return 0


def run_get(args: argparse.Namespace) -> int:
    """Write the payload of a product to a file."""
    from cdff_common.output import check_file, write_file

    check_file(args.out)
    data = _payload(args)
    write_file(args.out, data)
    line = {"id": args.id, "bytes": len(data), "file": str(args.out)}
    print(json.dumps(line) if args.json else f"{args.out}: {len(data)} bytes")
    return 0


def _payload(args: argparse.Namespace) -> bytes:
    from cdff_common.bus import Bus, keys
    from cdff_common.client import Client

    if args.format is None:
        with Client(args.connect, name="cdff dpm") as client:
            return client.get(args.id).data
    with Bus.open(args.connect, name="cdff dpm") as bus:
        reply = bus.call(keys.dpm_rpc(keys.GROUND, "get"), {"id": args.id, "format": args.format}, timeout_s=30.0)
        return reply.payload


def run_put(args: argparse.Namespace) -> int:
    """Insert a file and print its id."""
    from cdff_common.bus import Bus
    from services.dpm.put import put

    with Bus.open(args.connect, name="cdff dpm") as bus:
        done = put(bus, args)
    print(json.dumps(done) if args.json else f"{done['id']}  {done['result']}")
    return 0


def run_remove(args: argparse.Namespace) -> int:
    """Delete a product."""
    return _show(args, "delete", {"id": args.id})


def run_stat(args: argparse.Namespace) -> int:
    """Print what the DPM says of itself."""
    return _show(args, "stat", {})


def run_retention(args: argparse.Namespace) -> int:
    """Print one line per product that a rule lets go, then the sum."""
    from cdff_common.bus import Bus, keys

    asked = {"apply": "true" if args.apply else "false", "all": "true"}
    with Bus.open(args.connect, name="cdff dpm") as bus:
        for reply in bus.call_stream(keys.dpm_rpc(keys.GROUND, "retention"), asked, timeout_s=600.0):
            body = reply.body()
            for verdict in body["verdicts"]:
                fate = "goes " if verdict["retire"] else "stays"
                line = f"{fate}  {verdict['id']}  {verdict['product']:15} {verdict['robot']:10} {verdict['why']}"
                print(json.dumps(verdict) if args.json else line)
    if args.json:
        print(json.dumps({name: value for name, value in body.items() if name != "verdicts"}))
        return 0
    done = "deleted" if body["applied"] else "would be deleted"
    print(f"{body['rules']} rules: {body['retired']} products of {body['bytes']} B {done}, {body['kept']} stay")
    return 0


def _show(args: argparse.Namespace, verb: str, parameters: dict[str, str]) -> int:
    from cdff_common.bus import Bus, keys
    from cdff_common.json_form import jsonable

    with Bus.open(args.connect, name="cdff dpm") as bus:
        body = jsonable(bus.call(keys.dpm_rpc(keys.GROUND, verb), parameters).body())
    print(json.dumps(body, default=str, indent=None if args.json else 2))
    return 0


def run_verify(args: argparse.Namespace) -> int:
    """Print one line per problem; exit 1 if there is any."""
    from dpm_store import open_store
    from services.dpm.settings import parse_settings

    given = [] if args.data_dir is None else ["--data-dir", str(args.data_dir)]
    with open_store(parse_settings(given).store_url) as store:
        problems, count = store.verify(), store.statistics().count
    if args.json:
        found = [{"where": problem.where, "what": problem.what} for problem in problems]
        print(json.dumps({"products": count, "problems": found}))
    else:
        print("\n".join(f"{p.where}: {p.what}" for p in problems) or f"{count} products, all as they were written")
    return 1 if problems else 0


def run_backup(args: argparse.Namespace) -> int:
    """Copy a store that may be in use."""
    from dpm_store.backup import backup

    made = backup(_data_dir(args), args.out)
    found = {"products": made.products, "files": made.files, "bytes": made.bytes, "directory": str(args.out)}
    print(json.dumps(found) if args.json else f"{args.out}: {made.products} products, {made.bytes} B")
    return 0


def run_restore(args: argparse.Namespace) -> int:
    """Make a store of a backup and read everything in it; exit 1 if anything is not as it was written."""
    from dpm_store.backup import restore

    target = _data_dir(args)
    restore(args.backup, target)
    args.data_dir = str(target)
    return run_verify(args)


def _data_dir(args: argparse.Namespace) -> Path:
    from services.dpm.settings import parse_settings

    return parse_settings([] if args.data_dir is None else ["--data-dir", str(args.data_dir)]).data_dir

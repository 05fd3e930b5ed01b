# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm``: search, get, put, rm, retention, verify, rebuild, backup, restore, migrate and others."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

from cdff_common.process import data_dir_of
from services.dpm.cli import contact_commands, terrain_commands


def register(nouns: Any) -> None:
    """Add ``cdff dpm``."""
    parser = nouns.add_parser("dpm", help="search, fetch and delete products of a running DPM")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    search = verbs.add_parser("search", help="metadata of products, newest first")
    _add_search_arguments(search)
    search.add_argument("--quality", help="bounds of quality metrics, such as inliers>=30,rmse_px<0.5")
    search.add_argument("--order", choices=("newest", "oldest", "nearest"))
    search.add_argument(
        "--point", help="with --order nearest: x,y in the frame; default: the region's centre"
    )
    search.add_argument(
        "--frames-revision", type=int, help="state of the frame tree that locates the products"
    )
    search.add_argument("--limit", type=int, default=20)
    search.set_defaults(run=run_search)
    get = verbs.add_parser("get", help="the payload of a product")
    get.add_argument("id")
    get.add_argument("--format", help="uper ber xer msgpack tif ply png tum …; default: as stored")
    get.add_argument("--out", type=Path, required=True)
    get.set_defaults(run=run_get)
    put = verbs.add_parser("put", help="insert a file as a product")
    put.add_argument(
        "file", type=Path, help="ply pcd las laz bin tif json tum g2o png, or a payload: uper ber xer msgpack"
    )
    put.add_argument("--robot", required=True)
    put.add_argument("--type", help="pose trajectory pointcloud dem …; default: by the suffix")
    put.add_argument("--dfpc", default="manual", help="producer; default: manual")
    put.add_argument("--port", help="default: the type")
    put.add_argument("--frame", help="frame of a file that states none; default: site, of a mesh ROBOT/body")
    put.add_argument(
        "--unit", default="m", choices=("m", "mm", "cm", "km"), help="unit of the vertices of a mesh"
    )
    put.add_argument(
        "-t", "--t", help="time of capture: nanoseconds or RFC 3339; default: that in the file, else now"
    )
    put.set_defaults(run=run_put)
    remove = verbs.add_parser("rm", help="delete a product")
    remove.add_argument("id")
    remove.set_defaults(run=run_remove)
    withdraw = verbs.add_parser(
        "withdraw", help="remove bad patches, or all maps of a robot, from all maps; the history stays"
    )
    withdraw.add_argument("id", nargs="*", help="products")
    withdraw.add_argument("--robot", help="instead of ids: all maps of this robot")
    withdraw.add_argument("--dfpc")
    withdraw.add_argument("--t0", help="captured at or after: nanoseconds or RFC 3339")
    withdraw.add_argument("--t1", help="captured at or before")
    withdraw.add_argument("--type", help="product types, separated by commas; default: dem,navigation_map")
    withdraw.add_argument("--reason", required=True)
    withdraw.add_argument("--dry-run", action="store_true", help="only list the products")
    withdraw.set_defaults(run=run_withdraw)
    stat = verbs.add_parser("stat", help="counts and sizes")
    stat.set_defaults(run=run_stat)
    verify = verbs.add_parser(
        "verify", help="check the contents of a store while its DPM is stopped, and list defects"
    )
    verify.add_argument("--data-dir", type=Path, help="default: CDFF_DATA_DIR, ~/.local/share/cdff")
    verify.add_argument(
        "--authority", type=Path, help="certificate of the mission's authority: check the signatures, too"
    )
    verify.add_argument("--json", action="store_true")
    verify.set_defaults(run=run_verify)
    rebuild = verbs.add_parser(
        "rebuild",
        help="restore a damaged or missing database from the records of all changes and the payloads",
    )
    rebuild.add_argument("--data-dir", type=Path, help="default: CDFF_DATA_DIR, ~/.local/share/cdff")
    rebuild.add_argument("--json", action="store_true")
    rebuild.add_argument(
        "--remove-unnamed", action="store_true", help="then remove the payloads that no record names"
    )
    rebuild.set_defaults(run=run_rebuild)
    retention = verbs.add_parser(
        "retention", help="products to delete by the retention rules, with reasons; --apply deletes them"
    )
    how = retention.add_mutually_exclusive_group()
    how.add_argument("--dry-run", action="store_true", help="only list them (the default)")
    how.add_argument("--apply", action="store_true", help="delete them")
    retention.add_argument(
        "--confirm-clock",
        action="store_true",
        help="state that the mission time is correct, after the clock was lost or has jumped",
    )
    retention.set_defaults(run=run_retention)
    backup = verbs.add_parser("backup", help="copy a store on this machine, while its DPM runs and writes")
    backup.add_argument("out", type=Path, help="directory to be created")
    backup.add_argument("--data-dir", help="default: CDFF_DATA_DIR, ~/.local/share/cdff")
    backup.add_argument("--json", action="store_true")
    backup.set_defaults(run=run_backup)
    migrate = verbs.add_parser(
        "migrate",
        help="copy a store, also while its DPM runs, with its history to an empty one, and verify it",
    )
    migrate.add_argument("source", help="data directory or URL; repeat the command to copy later changes")
    migrate.add_argument(
        "target", help="URL: postgresql+psycopg://user@host/database?directory=/path&payloads=s3://bucket"
    )
    migrate.add_argument("--json", action="store_true")
    migrate.set_defaults(run=run_migrate)
    restore = verbs.add_parser("restore", help="restore a store from a backup and verify it")
    restore.add_argument("backup", type=Path)
    restore.add_argument("--data-dir", help="new or empty; default: CDFF_DATA_DIR, ~/.local/share/cdff")
    restore.add_argument("--json", action="store_true")
    restore.set_defaults(run=run_restore)
    export = verbs.add_parser(
        "export", help="write the products of a search as files: COG, PLY, LAZ, GeoJSON, TUM, g2o"
    )
    _export_arguments(export)
    terrain_commands.register(verbs)
    contact_commands.register(verbs)
    for verb in (search, get, put, remove, withdraw, stat, retention, export):
        verb.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
        verb.add_argument("--json", action="store_true")


def _add_search_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--type", help="pose trajectory pointcloud dem navigation_map …; several with commas")
    parser.add_argument("--robot")
    parser.add_argument("--dfpc")
    parser.add_argument("--region", help="bbox: box: circle: polygon: path: near:, metres")
    parser.add_argument("--frame", help="frame of the region, and of one file; default: site")
    parser.add_argument("--t0", help="captured at or after: nanoseconds or RFC 3339")
    parser.add_argument("--t1", help="captured at or before")
    parser.add_argument(
        "--tag", help="only products with this tag, or with all of several tags separated by commas"
    )
    parser.add_argument("--as-of", help="state of the store at this time: nanoseconds or RFC 3339")


def _export_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("out", type=Path, help="folder, or one file: tif ply las laz pcd tum geojson g2o")
    _add_search_arguments(parser)
    parser.add_argument("--format", help="format of the files in a folder, for types that support it")
    parser.add_argument(
        "--resolution-m", type=float, help="cell size of a tif, metres; coarser data are not resampled"
    )
    parser.add_argument("--points", type=int, help="largest number of points of one cloud")
    parser.set_defaults(run=run_export)


def run_export(args: argparse.Namespace) -> int:
    """Write files and list them."""
    from cdff_common.bus import Bus
    from cdff_common.progress import elapsed
    from services.dpm.cli.export import export

    with elapsed("export"), Bus.open(args.connect, name="cdff dpm") as bus:
        files = export(bus, args)
    if args.json:
        print(json.dumps({"files": files}))
        return 0
    for file in files:
        print(f"{file['file']}: {file['bytes']} bytes, {file['products']} products")
    return 0


def search_arguments(args: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments that are search parameters."""
    from cdff_common.contract.queries import SearchParameters

    arguments = {name: getattr(args, name, None) for name in SearchParameters.model_fields}
    return {name: value for name, value in arguments.items() if value is not None}


def run_search(args: argparse.Namespace) -> int:
    """Print one line per product."""
    from cdff_common.client import Client
    from cdff_common.clock import format_stamp
    from cdff_common.json_form import jsonable
    from cdff_common.terminal import print_table

    with Client(args.connect, name="cdff dpm") as client:
        items = client.search(**search_arguments(args))
    if args.json:
        print(json.dumps(jsonable([dict(item) for item in items])))
        return 0
    rows = [
        (
            *(item.id, item.product, item.robot, format_stamp(item.header.t1_ns), item.header.frame),
            *(f"{item.size} B", item.header.quality.status),
        )
        for item in items
    ]
    if rows:
        print_table(("id", "product", "robot", "captured", "frame", "size", "quality"), rows)
    if not items:
        print("no products")
    return 0


def run_get(args: argparse.Namespace) -> int:
    """Write the payload of a product to a file."""
    from cdff_common.client import Client
    from cdff_common.output import check_file, write_file

    check_file(args.out)
    with Client(args.connect, name="cdff dpm") as client:
        data = client.get(args.id, args.format).data
    write_file(args.out, data)
    line = {"id": args.id, "bytes": len(data), "file": str(args.out)}
    print(json.dumps(line) if args.json else f"{args.out}: {len(data)} bytes")
    return 0


def run_put(args: argparse.Namespace) -> int:
    """Insert a file and print its id."""
    from cdff_common.bus import Bus
    from services.dpm.cli.put import put

    with Bus.open(args.connect, name="cdff dpm") as bus:
        result = put(bus, args)
    print(json.dumps(result) if args.json else f"{result['id']}  {result['result']}")
    return 0


def run_remove(args: argparse.Namespace) -> int:
    """Delete a product."""
    return _show(args, "delete", {"id": args.id})


def run_withdraw(args: argparse.Namespace) -> int:
    """Withdraw products and list them."""
    from cdff_common.client import Client

    names = ("robot", "dfpc", "t0", "t1", "type")
    selection = {name: value for name in names if (value := getattr(args, name)) is not None}
    with Client(args.connect, name="cdff dpm") as client:
        result = client.withdraw(*args.id, reason=args.reason, dry_run=args.dry_run, **selection)
    if args.json:
        print(json.dumps(result))
        return 0
    for kind in ("withdrawn", "derived"):
        for product_id in result[kind]:
            print(f"{product_id}  {kind}")
    outcome = "removed from all maps" if result["applied"] else "would be removed"
    print(f"{len(result['withdrawn'])} products and {len(result['derived'])} made from them {outcome}")
    return 0


def run_stat(args: argparse.Namespace) -> int:
    """Print counts and sizes of the DPM."""
    return _show(args, "stat", {})


def run_retention(args: argparse.Namespace) -> int:
    """Print one line per retired product, then the sum."""
    from cdff_common.bus import Bus, keys

    parameters = {"apply": "true" if args.apply else "false", "all": "true"}
    parameters |= {"confirm_clock": "true"} if args.confirm_clock else {}
    with Bus.open(args.connect, name="cdff dpm") as bus:
        for reply in bus.call_stream(keys.dpm_rpc(keys.GROUND, "retention"), parameters, timeout_s=600.0):
            body = reply.body()
            for verdict in body["verdicts"]:
                decision = "retired" if verdict["retire"] else "kept   "
                line = f"{decision}  {verdict['id']}  {verdict['product']:15} "
                line += f"{verdict['robot']:10} {verdict['why']}"
                print(json.dumps(verdict) if args.json else line)
    if args.json:
        print(json.dumps({name: value for name, value in body.items() if name != "verdicts"}))
        return 0
    outcome = "deleted" if body["applied"] else "would be deleted"
    print(
        f"{body['rules']} rules: {body['retired']} products of {body['bytes']} B {outcome}, "
        f"{body['kept']} stay"
    )
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
    from cdff_common.progress import elapsed
    from dpm_store import open_store
    from services.dpm.settings import Settings

    with elapsed("verification"), open_store(Settings(data_dir_of(args.data_dir)).store_url) as store:
        problems, count, unnamed = store.verify(), store.statistics().count, store.unnamed_payloads()
        signed = None
        if args.authority is not None:
            from services.dpm.cli.signatures import signature_problems

            signed, forged = signature_problems(store, args.authority)
            problems += forged
    if args.json:
        defects = [{"where": problem.where, "what": problem.what} for problem in problems]
        summary = {"products": count, "problems": defects, "unnamed_files": unnamed.files}
        print(json.dumps(summary if signed is None else summary | {"signed": signed}))
    else:
        print(
            "\n".join(f"{p.where}: {p.what}" for p in problems)
            or f"{count} products, all as they were written"
        )
        if signed is not None:
            print(f"{signed} of {count} products are signed")
        if unnamed.files:
            print(f"{unnamed.files} payload files without a row, such as those of interrupted insertions")
    return 1 if problems else 0


def run_rebuild(args: argparse.Namespace) -> int:
    """Rebuild a database and verify it; exit 1 if products are lost."""
    from cdff_common.progress import elapsed
    from dpm_store.changes.rebuild import rebuild

    with elapsed("rebuild"):
        result = rebuild(data_dir_of(args.data_dir), remove_unnamed=args.remove_unnamed)
    if args.json:
        summary = {"products": result.products, "lost": result.lost, "replaced": str(result.replaced)}
        print(json.dumps(summary))
    else:
        for product_id in result.lost:
            print(f"product {product_id}: its payload is missing or corrupt")
        print(f"{result.products} products; the old database is in {result.replaced}")
    return 1 if result.lost else 0


def run_migrate(args: argparse.Namespace) -> int:
    """Copy a store to an empty one and verify it; exit 1 if products are lost or the stores differ."""
    from cdff_common.progress import elapsed
    from dpm_store import open_store
    from dpm_store.changes.migration import copy_store

    with elapsed("migrate"), open_store(_store_url(args.target)) as target:
        result = copy_store(_store_url(args.source), target)
    if args.json:
        counts = {"changes": result.changes, "products": result.products}
        print(json.dumps({**counts, "lost": result.lost, "problems": result.problems}))
    else:
        for product_id in result.lost:
            print(f"product {product_id}: its payload is missing or corrupt in {args.source}")
        for problem in result.problems:
            print(problem)
        verified = "with problems" if result.problems else "verified"
        print(f"{result.changes} changes copied; {result.products} products, {verified}")
    return 1 if result.lost or result.problems else 0


def _store_url(location: str) -> str:
    """Return the URL of a store that is given by a URL or a directory."""
    return location if "://" in location else f"sqlite:///{Path(location).absolute()}"


def run_backup(args: argparse.Namespace) -> int:
    """Copy a store that may be in use."""
    from cdff_common.progress import elapsed
    from dpm_store.history.backup import backup

    with elapsed("backup"):
        copy = backup(data_dir_of(args.data_dir), args.out)
    summary = {
        "products": copy.products,
        "files": copy.files,
        "bytes": copy.bytes,
        "directory": str(args.out),
    }
    print(json.dumps(summary) if args.json else f"{args.out}: {copy.products} products, {copy.bytes} B")
    return 0


def run_restore(args: argparse.Namespace) -> int:
    """Restore a store from a backup and verify it; exit 1 if there is a defect."""
    from cdff_common.progress import elapsed
    from dpm_store.history.backup import backup

    target = data_dir_of(args.data_dir)
    with elapsed("restoration"):
        backup(args.backup, target)
    args.data_dir, args.authority = str(target), None
    return run_verify(args)

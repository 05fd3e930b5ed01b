# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff request`` and ``cdff orchestrator jobs|cancel|catalogue|history``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from contextlib import closing
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_common.clock import parse_stamp
from cdff_common.errors import InputError

if TYPE_CHECKING:
    from cdff_common.client import Answer
    from cdff_common.client.wishes import Wishes

#: Other spellings of endings that name a format.
_ENDINGS = {"tiff": "tif", "xml": "xer"}
#: Kinds of journal records that an orchestrator forwards to the history, and what of them a line shows.
AUDIT_KINDS = ("start", "job", "lease", "activation", "mode", "decision")
_TOLD = (
    "job", "holder", "state", "dfpc", "sensor", "mode", "action", "ok", "makers", "displaced_by", "no_plan", "reason",
)  # fmt: skip
_TYPES = ("pose", "trajectory", "pointcloud", "dem", "navigation_map", "image")


def register_request(nouns: Any) -> None:
    """Add ``cdff request``."""
    parser = nouns.add_parser("request", help="ask the orchestrator for a product")
    parser.add_argument("type", choices=_TYPES)
    parser.add_argument("--robot", default="any", help="robot id, or any")
    parser.add_argument("--region", help="bbox: box: circle: polygon: path: near:, metres")
    parser.add_argument("--region-frame", help="frame of the region; default: --frame")
    parser.add_argument("--frame", help="frame to have it in; default: site")
    parser.add_argument("--child", help="of a pose: whose; default: the robot's base")
    parser.add_argument("--t", help="mission time to have it of: RFC 3339 or nanoseconds; default: the newest")
    parser.add_argument("--max-age-s", type=float)
    parser.add_argument("--resolution-m", type=float)
    parser.add_argument("--min-coverage", type=float)
    parser.add_argument("--as", dest="as_type", help="InFuse type, as Map or RigidBodyState")
    parser.add_argument(
        "--format", help="uper ber xer msgpack tif ply tum png; default: by the ending of --out, without a file uper"
    )
    parser.add_argument("--deliver", choices=("auto", "inline", "reference"))
    parser.add_argument("--deadline-s", type=float, default=20.0)
    parser.add_argument("--priority", type=int, choices=range(10), help="9 goes first; default: 5")
    parser.add_argument(
        "--every-s", type=float, help="stay and take each newer one, not more often than this; 0: each change"
    )
    parser.add_argument("--count", type=int, help="with --every-s: end after so many; default: until interrupted")
    parser.add_argument("--explain", action="store_true", help="say what would be done, at what cost; run nothing")
    parser.add_argument("--out", type=Path, help="file for the payload")
    parser.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(run=run_request)


def register_orchestrator(nouns: Any) -> None:
    """Add ``cdff orchestrator``."""
    parser = nouns.add_parser("orchestrator", help="what the orchestrator does and could do")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    jobs = verbs.add_parser("jobs", help="requests and where they stand")
    jobs.add_argument("--limit", type=int, default=20)
    jobs.set_defaults(run=run_jobs)
    cancel = verbs.add_parser("cancel", help="cancel a request")
    cancel.add_argument("job", help="id of the job or of the request")
    cancel.set_defaults(run=run_cancel)
    catalogue = verbs.add_parser("catalogue", help="what could be asked for, and why not")
    catalogue.add_argument("--type", help="of this product alone: every way to it, or why there is none")
    catalogue.set_defaults(run=run_catalogue)
    history = verbs.add_parser("history", help="requests, decisions, activations and mode changes, from the DPM")
    history.add_argument("--since", type=int, default=0, help="ordinal of the last entry that is known")
    history.add_argument("--limit", type=int, default=1000)
    history.add_argument("--job", help="only what concerns this job")
    history.set_defaults(run=run_history)
    for verb in (jobs, cancel, catalogue, history):
        verb.add_argument("--robot", default="any")
        verb.add_argument("--connect", help="endpoint of the router; CDFF_CONNECT, tcp/127.0.0.1:7447")
        verb.add_argument("--json", action="store_true")


def run_request(args: argparse.Namespace) -> int:
    """Ask, show what came, write the payload where a file is named."""
    from cdff_common.client import Client  # heavy: zenoh and the types
    from cdff_common.output import check_file

    if args.every_s is None and args.count is not None:
        raise InputError(f"--count {args.count}: expected together with --every-s")
    if args.count is not None and args.count < 1:
        raise InputError(f"--count {args.count}: expected at least 1")
    form = args.format or format_of(args.out, args.type)
    if args.out is not None:
        check_file(args.out)
    show = _progress if sys.stderr.isatty() and not args.json else None
    wishes = _wishes(args, form)
    with Client(args.connect, name="cdff request") as client:
        if args.explain:
            told = client.explain(args.type, robot=args.robot, deadline_s=args.deadline_s, **wishes)
            return _show_explanation(told, args.json)
        if args.every_s is None:
            answer = client.request(args.type, robot=args.robot, deadline_s=args.deadline_s, on_progress=show, **wishes)
            _take(answer, args)
            return 0
        with closing(client.standing(args.type, robot=args.robot, every_s=args.every_s, **wishes)) as answers:
            for answer in islice(answers, args.count):
                _take(answer, args)
    return 0


def _wishes(args: argparse.Namespace, form: str | None) -> Wishes:
    return {
        "region": args.region,
        "region_frame": args.region_frame,
        "frame": args.frame,
        "child": args.child,
        "t_ns": None if args.t is None else parse_stamp(args.t, "--t"),
        "max_age_s": args.max_age_s,
        "resolution_m": args.resolution_m,
        "min_coverage": args.min_coverage,
        "as_type": args.as_type,
        "format": form,
        "deliver": args.deliver,
        "priority": args.priority,
    }


def _take(answer: Answer, args: argparse.Namespace) -> None:
    """Write the payload where a file is named, and tell what came."""
    from cdff_common.output import write_file

    if args.out is not None:
        write_file(args.out, answer.data)
    summary = answer.summary()
    if args.json:
        _print_json(summary)
        return
    delivered, quality = summary["delivered"], summary["header"]["quality"]
    print(f"{summary['type']} of {summary['robot']}, {summary['size']} bytes, {quality['status']}", flush=True)
    for reason in quality["reasons"]:
        print(f"  {reason}")
    for name, value in delivered.items():
        if value not in (None, []):
            print(f"  {name}: {value}")
    if args.out is not None:
        print(f"  written to {args.out}")


def _show_explanation(told: dict[str, Any], as_json: bool) -> int:
    if as_json:
        _print_json(told)
        return 0
    stored = told["stored"]
    if told["would"] == "serve":
        print(f"would serve product {stored['id']} from the DPM, {stored['age_s']:.3f} s old")
    else:
        print(f"not served from the DPM: {told['why_not_stored']}")
    for title, plan in [("would make it" if told["would"] == "make" else "could make it", told["plan"])] + [
        ("or else", p) for p in told["alternatives"]
    ]:
        if plan is not None:
            print(f"{title}: {' -> '.join(plan['order'])}, cost {plan['cost']:g}")
            print(f"  adds {plan['added_cpu_cores']:g} CPU cores and {plan['added_memory_mb']:g} MB")
            for sensor, (before, after) in plan["changes"].items():
                print(f"  sets {sensor} from {before} to {after}")
            for port in plan["unfed"]:
                print(f"  without {port}")
    for reason in told["why_not"]:
        print(f"cannot be made: {reason}")
    for refused in told["refused"]:
        print(f"not {refused['maker']}: {refused['why_not']}")
    return 0


def run_jobs(args: argparse.Namespace) -> int:
    """List jobs, newest first."""
    from cdff_common.client import Client

    with Client(args.connect, name="cdff orchestrator") as client:
        jobs = client.jobs(args.robot, limit=args.limit)
    if args.json:
        _print_json({"jobs": jobs})
        return 0
    for job in jobs:
        request = job["request"]
        what = f"{request['type']} of {request['robot']}" + (f" {request['region']}" if request["region"] else "")
        print(f"{job['job']}  {job['state']:10}  {what}" + (f"  ({job['reason']})" if job["reason"] else ""))
    return 0


def run_cancel(args: argparse.Namespace) -> int:
    """Cancel one job."""
    from cdff_common.client import Client

    with Client(args.connect, name="cdff orchestrator") as client:
        client.cancel(args.job, args.robot)
    print(json.dumps({"cancelled": args.job}) if args.json else f"{args.job} is being cancelled")
    return 0


def run_history(args: argparse.Namespace) -> int:
    """List what the orchestrator did and why, oldest first."""
    from cdff_common.client import Client
    from cdff_common.clock import format_stamp

    with Client(args.connect, name="cdff orchestrator") as client:
        found = client.history(kinds=AUDIT_KINDS, robot=args.robot, since=args.since, limit=args.limit)
    items = [i for i in found if args.job is None or args.job in (i.get("job"), i.get("holder"))]
    if args.json:
        _print_json({"items": items})
        return 0
    for item in items:
        told = " ".join(f"{name}={item[name]}" for name in _TOLD if item.get(name) not in (None, "", []))
        print(f"{item['ordinal']:8} {format_stamp(item['stamp_ns'])} {item['scope']:10} {item['kind']:10} {told}")
    return 0


def run_catalogue(args: argparse.Namespace) -> int:
    """List what can be made, by what, and why not."""
    from cdff_common.client import Client

    with Client(args.connect, name="cdff orchestrator") as client:
        catalogue = client.catalogue(args.robot, args.type)
    if args.json:
        _print_json(catalogue)
        return 0
    for product in catalogue["products"]:
        plan = product.get("plan")
        how = f"not now: {product.get('why_not')}" if plan is None else " -> ".join(plan["order"])
        print(f"{product['robot']:12} {product['type']:16} {how}")
        for way in product["by"] if args.type else ():
            cost = f"{way['cpu_cores']:.3f} cores, {way['memory_mb']:g} MB, ready in {way['ready_s']:g} s"
            grain = "" if way["resolution_m"] is None else f", {way['resolution_m']:g} m"
            print(f"{'':12}   {way['dfpc']}/{way['implementation']}: {cost}{grain} {'; '.join(way.get('why_not', ()))}")
        if args.type and product.get("nearest"):
            print(f"{'':12}   nearest: {', '.join(product['nearest'])}")
    for dfpc in catalogue["dfpcs"]:
        state = "active" if dfpc["active"] else "there" if dfpc["alive"] else "not there"
        print(f"{dfpc['robot']:12} {dfpc['name']:28} {dfpc['implementation']:24} {state}")
    for sensor in catalogue["sensors"]:
        print(f"{sensor['robot']:12} {sensor['sensor']:28} {sensor['mode']}" + (" (held)" if sensor["held"] else ""))
    return 0


def _progress(body: Mapping[str, Any]) -> None:
    print(f"  {body['state']}: {body['reason']}", file=sys.stderr)


def _print_json(data: Any) -> None:
    from cdff_common.json_form import jsonable

    print(json.dumps(jsonable(data)), flush=True)


def format_of(out: Path | None, product: str) -> str | None:
    """The format that a file's name asks for, None without a file; raises InputError where its ending names none."""
    if out is None:
        return None
    from cdff_core.orchestration.request import CODECS, PRODUCTS

    ending = out.suffix.lower().removeprefix(".")
    form = _ENDINGS.get(ending, ending)
    known = (*CODECS, *PRODUCTS[product][2])
    if form not in known:
        raise InputError(
            f"--out {out}: the ending {out.suffix!r} names no format of a {product}, expected one of "
            f"{', '.join(f'.{k}' for k in known)}; or say what the file shall hold with --format"
        )
    return form

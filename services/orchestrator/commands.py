# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff request`` and ``cdff orchestrator jobs|cancel|catalogue|history``."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from contextlib import closing, redirect_stdout
from functools import partial
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

from cdff_common.cli import add_connect_option, add_plot_option
from cdff_common.clock import format_stamp, parse_stamp
from cdff_common.errors import InputError
from cdff_common.json_form import jsonable
from cdff_common.output import check_file, format_of_suffix, is_standard_output, write_output
from cdff_common.terminal import print_table

if TYPE_CHECKING:
    from cdff_common.client import Answer, Client

#: Kinds of records in the history, and the printed fields.
AUDIT_KINDS = ("start", "job", "schedule", "lease", "activation", "mode", "decision", "control")
_FIELDS = (
    *("job", "holder", "state", "dfpc", "sensor", "mode", "action", "ok", "providers"),
    *("displaced_by", "no_plan", "reason"),
)


def register_request(nouns: Any) -> None:
    """Add ``cdff request``."""
    parser = nouns.add_parser("request", help="request a product from the orchestrator")
    parser.add_argument("type", help="product: pose trajectory pointcloud dem navigation_map image …")
    parser.add_argument("--robot", default="any", help="robot id, or any")
    parser.add_argument(
        "--region",
        help="region in metres, such as circle:0,0,10; forms: bbox: box: circle: polygon: path: near:",
    )
    parser.add_argument("--region-frame", help="frame of the region; default: --frame")
    parser.add_argument("--frame", help="frame of the product; default: site")
    parser.add_argument("--child", help="child frame of a pose; default: base of the robot")
    parser.add_argument(
        "--t",
        dest="t_ns",
        type=partial(parse_stamp, name="--t"),
        help="mission time of the product: RFC 3339 or nanoseconds; default: the newest",
    )
    for name, what in (("--t0", "start"), ("--t1", "end")):
        parse = partial(parse_stamp, name=name)
        parser.add_argument(
            name, type=parse, help=f"{what} of the capture of a scheduled request, mission time"
        )
    parser.add_argument("--max-age-s", type=float, help="largest age of the product, seconds")
    parser.add_argument("--resolution-m", type=float, help="size of cells or spacing of points, metres")
    parser.add_argument("--min-coverage", type=float, help="least covered fraction of the region, 0 to 1")
    _add_accuracy_options(parser)
    parser.add_argument(
        "--as", dest="as_type", help="InFuse type of the reply, such as Map or RigidBodyState"
    )
    parser.add_argument(
        "--format",
        help="uper ber xer msgpack tif ply tum png; default: by the suffix of --out, uper without --out",
    )
    parser.add_argument(
        "--deliver",
        choices=("auto", "inline", "reference"),
        help="reply with the product, or with its id in the DPM; default: auto, by size",
    )
    parser.add_argument(
        "--deadline-s", type=float, default=20.0, help="time limit of the final reply; default: 20"
    )
    parser.add_argument(
        "--priority", type=int, choices=range(10), help="0 to 9, 9 is served first; default: 5"
    )
    parser.add_argument(
        "--acquire",
        metavar="now|NAME:VALUE,…",
        help="one acquisition of the sensors for this request, with its parameters, such as pan_deg:30",
    )
    parser.add_argument(
        "--every-s",
        type=float,
        help="standing request: least time between replies with newer products; 0: reply at each change",
    )
    parser.add_argument(
        "--count", type=int, help="with --every-s: number of replies; default: until interrupted"
    )
    parser.add_argument(
        "--explain", action="store_true", help="print the plan, its cost and alternatives without running it"
    )
    parser.add_argument(
        "--out", type=Path, help="file to which the payload is written; - for standard output"
    )
    add_plot_option(parser)
    add_connect_option(parser)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output")
    parser.set_defaults(run=run_request, print_text=_print_summary)


def _add_accuracy_options(parser: argparse.ArgumentParser) -> None:
    """Add the bounds on the accuracy of a product."""
    parser.add_argument(
        "--max-oldest-age-s", type=float, help="largest age of the oldest part of a map, seconds"
    )
    parser.add_argument(
        "--max-sigma-m",
        type=float,
        help="largest standard deviation of the position, or of the elevation of a map, metres",
    )
    parser.add_argument(
        "--max-sigma-deg", type=float, help="largest standard deviation of the orientation, degrees"
    )
    parser.add_argument(
        "--covariance-kind", choices=("formal", "calibrated"), help="weakest kind of covariance"
    )
    parser.add_argument("--status", choices=("OK",), help="OK: no DEGRADED product")


def register_orchestrator(nouns: Any) -> None:
    """Add ``cdff orchestrator``."""
    parser = nouns.add_parser("orchestrator", help="jobs, catalogue and history of the orchestrator")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    jobs = verbs.add_parser("jobs", help="list requests and their states")
    jobs.add_argument("--limit", type=int, default=20, help="largest number of jobs; default: 20")
    jobs.set_defaults(call=_jobs, print_text=_print_jobs)
    cancel = verbs.add_parser("cancel", help="cancel a request")
    cancel.add_argument("job", help="id of the job or of the request")
    cancel.set_defaults(call=_cancel, print_text=lambda data, _: print(f"{data['cancelled']} is cancelled"))
    catalogue = verbs.add_parser("catalogue", help="list available products, or why they are not available")
    catalogue.add_argument("--type", help="only this product, with all its providers")
    catalogue.set_defaults(call=_catalogue, print_text=_print_catalogue)
    history = verbs.add_parser(
        "history", help="list requests, decisions, activations and mode changes from the DPM"
    )
    history.add_argument("--since", type=int, default=0, help="only entries after this ordinal")
    history.add_argument("--limit", type=int, default=1000, help="largest number of entries; default: 1000")
    history.add_argument("--job", help="only entries of this job")
    history.set_defaults(call=_history, print_text=_print_history)
    for verb in (jobs, cancel, catalogue, history):
        verb.add_argument("--robot", default="any", help="robot id, or any")
        add_connect_option(verb)
        verb.add_argument("--json", action="store_true", help="one JSON object on standard output")
        verb.set_defaults(run=run_orchestrator)


def run_request(args: argparse.Namespace) -> int:
    """Send a request, print the reply and write its payload."""
    from cdff_common.client import Client  # heavy: zenoh and the types
    from cdff_common.client.request_options import RequestOptions, parameters_of
    from cdff_common.contract.queries import RequestParameters

    if args.every_s is None and args.count is not None:
        raise InputError(f"--count {args.count}: expected together with --every-s")
    if args.count is not None and args.count < 1:
        raise InputError(f"--count {args.count}: expected at least 1")
    args.format = args.format or format_of(args.out, args.type)
    if args.out is not None:
        check_file(args.out)
    _check_plot(args)
    options = cast("RequestOptions", {name: getattr(args, name) for name in RequestOptions.__annotations__})
    # A malformed request is reported without a router.
    window = {"t0": args.t0, "t1": args.t1, "every_s": args.every_s}
    window = {name: value for name, value in window.items() if value is not None}
    RequestParameters.parse(parameters_of(args.type, args.robot, **options) | window)
    with Client(args.connect, name="cdff request") as client:
        if args.explain:
            explanation = client.explain(args.type, robot=args.robot, deadline_s=args.deadline_s, **options)
            args.print_text = _print_explanation
            _show(explanation, args)
        elif args.t0 is not None:
            args.print_text = _print_scheduled
            _show(client.schedule(args.type, robot=args.robot, **window, **options), args)
        elif args.every_s is None:
            show = _progress if sys.stderr.isatty() and not args.json else None
            answer = client.request(
                args.type, robot=args.robot, deadline_s=args.deadline_s, on_progress=show, **options
            )
            _output(answer, args)
        else:
            standing = client.standing(args.type, robot=args.robot, every_s=args.every_s, **options)
            with closing(standing) as answers:
                for answer in islice(answers, args.count):
                    _output(answer, args)
    return 0


def _print_scheduled(scheduled: dict[str, Any], _: argparse.Namespace) -> None:
    print(f"request {scheduled['request']} is scheduled")
    for reason in () if scheduled["plan"] else scheduled["why_not"]:
        print(f"no plan now: {reason}")


def _show(data: dict[str, Any], args: argparse.Namespace) -> None:
    """Print data as one JSON object, or as text by ``args.print_text``."""
    if args.json:
        print(json.dumps(jsonable(data)), flush=True)
    else:
        args.print_text(data, args)


def _output(answer: Answer, args: argparse.Namespace) -> None:
    """Write the payload and the plot, if requested; print a summary and the value in words.

    With the payload on standard output the text is on standard error.
    """
    from cdff_common.codecs.dict_form import to_dict_form
    from cdff_common.value_text import value_lines

    if args.out is not None:
        write_output(args.out, answer.data)
    if args.plot is not None:
        from cdff_common.plots import figure_of, write_figure

        write_figure(args.plot, figure_of({f"{args.type} of {answer.robot}": answer.value}))
    summary = answer.summary()
    if args.json and args.out is None and answer.value is not None:
        summary["value"] = to_dict_form(answer.value)
    with redirect_stdout(sys.stderr if is_standard_output(args.out) else sys.stdout):
        _show(summary, args)
        if not args.json and answer.value is not None:
            print("".join(f"  {line}\n" for line in value_lines(answer.value)), end="", flush=True)


def _check_plot(args: argparse.Namespace) -> None:
    """Raise an error before the request if its plot cannot be drawn or written."""
    if args.plot is None:
        return
    from cdff_common.codecs import CODECS
    from cdff_common.plots import check_plot_file

    check_plot_file(args.plot)
    if args.format is not None and args.format not in CODECS:
        raise InputError(
            f"--plot draws the value, but --format {args.format} delivers a file: omit one of them"
        )


def _print_summary(summary: dict[str, Any], args: argparse.Namespace) -> None:
    quality = summary["header"]["quality"]
    print(
        f"{summary['type']} of {summary['robot']}, {summary['size']} bytes, {quality['status']}", flush=True
    )
    for reason in quality["reasons"]:
        print(f"  {reason}")
    for name, value in summary["delivered"].items():
        if value not in (None, []):
            print(f"  {name}: {value}")
    if args.out is not None and not is_standard_output(args.out):
        print(f"  written to {args.out}")


def _print_explanation(explanation: dict[str, Any], _: argparse.Namespace) -> None:
    stored = explanation["stored"]
    if explanation["would"] == "serve":
        print(f"would serve product {stored['id']} from the DPM, {_age(stored['age_s'])}")
    else:
        print(f"not served from the DPM: {explanation['why_not_stored']}")
    title = "would make it" if explanation["would"] == "make" else "could make it"
    for plan in (explanation["plan"], *explanation["alternatives"]):
        if plan is not None:
            print(f"{title}: {' -> '.join(plan['order'])}, cost {plan['cost']:g}")
            print(f"  adds {plan['added_cpu_cores']:g} CPU cores and {plan['added_memory_mb']:g} MB")
            for sensor, (before, after) in plan["changes"].items():
                print(f"  sets {sensor} from {before} to {after}")
            for port in plan["omitted_inputs"]:
                print(f"  without {port}")
        title = "or else"
    for reason in explanation["why_not"]:
        print(f"cannot be made: {reason}")
    for refused in explanation["refused"]:
        print(f"not {refused['provider']}: {refused['why_not']}")


def run_orchestrator(args: argparse.Namespace) -> int:
    """Call the orchestrator or the history of the DPM, and print the result."""
    from cdff_common.client import Client

    with Client(args.connect, name="cdff orchestrator") as client:
        data = args.call(client, args)
    _show(data, args)
    return 0


def _jobs(client: Client, args: argparse.Namespace) -> dict[str, Any]:
    listed = client.requests(args.robot, limit=args.limit)
    return {name: listed[name] for name in ("jobs", "scheduled", "unreachable")}


def _print_jobs(data: dict[str, Any], _: argparse.Namespace) -> None:
    rows = []
    for job in (*data["scheduled"], *data["jobs"]):
        request = job["request"]
        region = f" {request['region']}" if request["region"] else ""
        reason = f"  ({job['reason']})" if job["reason"] else ""
        rows.append((job["job"], job["state"], f"{request['type']} of {request['robot']}{region}{reason}"))
    print_table(("job", "state", "request"), rows)
    if data["unreachable"]:
        print(f"without answer: the orchestrator of {', '.join(data['unreachable'])}", file=sys.stderr)


def _cancel(client: Client, args: argparse.Namespace) -> dict[str, Any]:
    client.cancel(args.job, args.robot)
    return {"cancelled": args.job}


def _history(client: Client, args: argparse.Namespace) -> dict[str, Any]:
    entries = client.history(kinds=AUDIT_KINDS, robot=args.robot, since=args.since, limit=args.limit)
    return {"items": [i for i in entries if args.job is None or args.job in (i.get("job"), i.get("holder"))]}


def _print_history(data: dict[str, Any], _: argparse.Namespace) -> None:
    rows = []
    for item in data["items"]:
        fields = " ".join(f"{name}={item[name]}" for name in _FIELDS if item.get(name) not in (None, "", []))
        rows.append((item["ordinal"], format_stamp(item["stamp_ns"]), item["scope"], item["kind"], fields))
    print_table(("ordinal", "time", "scope", "kind", "fields"), rows)


def _catalogue(client: Client, args: argparse.Namespace) -> dict[str, Any]:
    return client.catalogue(args.robot, args.type)


def _print_catalogue(catalogue: dict[str, Any], args: argparse.Namespace) -> None:
    """Print the products with their plans or obstacles; all providers of a requested one."""
    for product in catalogue["products"]:
        plan = product.get("plan")
        how = f"not now: {product.get('why_not')}" if plan is None else " -> ".join(plan["order"])
        print(f"{product['robot']:12} {product['type']:16} {how}")
        for offer in product["by"] if args.type else ():
            cost = (
                f"{offer['cpu_cores']:.3f} cores, {offer['memory_mb']:g} MB, ready in {offer['ready_s']:g} s"
            )
            obstacles = "; ".join(offer.get("why_not", ()))
            resolution = "" if offer["resolution_m"] is None else f", {offer['resolution_m']:g} m"
            print(f"{'':12}   {offer['dfpc']}/{offer['implementation']}: {cost}{resolution} {obstacles}")
        if args.type and product.get("nearest"):
            print(f"{'':12}   nearest: {', '.join(product['nearest'])}")
    for dfpc in catalogue["dfpcs"]:
        state = "active" if dfpc["active"] else "running" if dfpc["alive"] else "not running"
        print(f"{dfpc['robot']:12} {dfpc['name']:28} {dfpc['implementation']:24} {state}")
    for sensor in catalogue["sensors"]:
        held_text = " (held)" if sensor["held"] else ""
        print(f"{sensor['robot']:12} {sensor['sensor']:28} {sensor['mode']}{held_text}")


def _age(age_s: float) -> str:
    """Return an age in words; a capture can be ahead of the mission clock."""
    return f"{age_s:.3f} s old" if age_s >= 0.0 else f"ahead of the clock by {-age_s:.3f} s"


def _progress(body: Mapping[str, Any]) -> None:
    print(f"  {body['state']}: {body['reason']}", file=sys.stderr)


def format_of(out: Path | None, product: str) -> str | None:
    """Return the format selected by the suffix of a file, None without a file; raises InputError."""
    from cdff_core.orchestration.request import requested_type

    formats = requested_type(product).formats
    try:
        if out is None or is_standard_output(out):
            return None
        return format_of_suffix(out, formats, product)
    except InputError as error:
        raise InputError(f"{error}; or select a format with --format") from error

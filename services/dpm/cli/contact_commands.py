# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff dpm contact``: commands that show and control the exchange with robots over contact windows."""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from typing import Any

from cdff_common.cli import add_connect_option
from cdff_common.errors import InputError

_HELP = {
    "status": "contact, next window, backlog and counters of each robot",
    "plan": "windows that have not ended",
    "estimate": "products of a robot that are not at the ground, with their expected arrival",
    "requests": "requests that are kept for robots, and their states",
    "request": "keep a request for a robot that is out of contact",
    "first": "send a product of a robot before all others",
}


def register(verbs: Any) -> None:
    """Add ``cdff dpm contact``."""
    parser = verbs.add_parser("contact", help="exchange with robots over contact windows")
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for name, text in _HELP.items():
        command = commands.add_parser(name, help=text)
        add_connect_option(command)
        command.add_argument("--json", action="store_true")
        command.set_defaults(run=run_contact, of_contact=name)
        match name:
            case "plan":
                command.add_argument("--robot", help="default: all")
            case "estimate":
                command.add_argument("robot")
            case "requests":
                command.add_argument("--id", help="only this request")
            case "request":
                command.add_argument("robot")
                command.add_argument("type", help="product type")
                command.add_argument("parameters", nargs="*", help="further parameters, as region=box:…")
                command.add_argument("--expires-s", type=float, help="default: a day")
            case "first":
                command.add_argument("robot")
                command.add_argument("id", help="product, as listed by estimate")


def run_contact(args: argparse.Namespace) -> int:
    """Print the answer of the DPM on the ground."""
    from cdff_common.client import Client

    with Client(args.connect, name="cdff dpm contact") as client:
        answer = _answer(client, args)
    if args.json:
        print(json.dumps(answer))
        return 0
    for line in _lines(args.of_contact, answer):
        print(line)
    return 0


def _answer(client: Any, args: argparse.Namespace) -> Any:
    match args.of_contact:
        case "plan" | "estimate":
            return client.contact(args.of_contact, robot=args.robot)
        case "requests":
            return client.contact("requests", id=args.id)
        case "first":
            return client.contact(robot=args.robot, first=args.id)
        case "request":
            options = dict(_pair(text) for text in args.parameters)
            return client.request_after_contact(args.type, args.robot, expires_s=args.expires_s, **options)
    return client.contact()


def _pair(text: str) -> tuple[str, str]:
    name, separator, value = text.partition("=")
    if not separator:
        raise InputError(f"parameter {text[:64]!r}: expected NAME=VALUE")
    return name, value


def _lines(command: str, answer: Mapping[str, Any]) -> list[str]:
    """Return the answer as text."""
    match command:
        case "status":
            return [_status_line(robot, status) for robot, status in answer["robots"].items()]
        case "plan":
            return [_window_line(window) for window in answer["items"]] or ["the plan has no further window"]
        case "estimate":
            items = [*answer["items"], *answer["others"]]
            lines = [_arrival_line(item) for item in items]
            return [*lines, f"everything known arrives {_stamp(answer['complete_ns'])}"]
        case "requests" if "items" in answer:
            return [_request_line(item) for item in answer["items"]] or ["no request is kept"]
        case "first":
            return [_arrival_line(answer)]
    return [_request_line(answer)]


def _stamp(time_ns: int | None) -> str:
    from cdff_common.clock import format_stamp

    return "in no window of the plan" if time_ns is None else f"at {format_stamp(time_ns)}"


def _status_line(robot: str, status: Mapping[str, Any]) -> str:
    contact = "in contact" if status["contact"] else f"next window {_stamp(status['next_window_ns'])}"
    count = sum(row[1] for row in status["backlog"])
    nbytes = sum(row[2] for row in status["backlog"])
    return f"{robot}: {contact}; at the last contact {count} products ({nbytes} bytes) were to be sent"


def _window_line(window: Mapping[str, Any]) -> str:
    state = " (open)" if window["open"] else ""
    times = f"{_stamp(window['start_ns'])} to {_stamp(window['end_ns']).removeprefix('at ')}"
    return f"{window['robot']}: {times}, {window['rate_bit_s']:g} bit/s, delay {window['delay_s']:g} s{state}"


def _arrival_line(item: Mapping[str, Any]) -> str:
    name, nbytes = item.get("id") or item["what"], item.get("missing", item.get("bytes"))
    return (
        f"{name}: priority {item['priority']}, {nbytes} bytes missing, arrives {_stamp(item['arrives_ns'])}"
    )


def _request_line(request: Mapping[str, Any]) -> str:
    result = request["result"] or {}
    end = result.get("error") or result.get("id") or f"expires {_stamp(request['expires_ns'])}"
    return (
        f"{request['id']}: {request['robot']}, {request['parameters'].get('type')}, {request['state']}; {end}"
    )

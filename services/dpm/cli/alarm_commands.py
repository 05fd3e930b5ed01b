# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff alarms [--all]`` and ``cdff alarms ack KIND/SOURCE``."""

from __future__ import annotations

import argparse
import json
from typing import TYPE_CHECKING, Any

from cdff_common.cli import add_connect_option
from cdff_common.errors import InputError

if TYPE_CHECKING:
    from cdff_common.bus import Bus

_CALL_S = 10.0
#: Number of events in one answer of the DPM.
_PAGE = 1000


def register(nouns: Any) -> None:
    """Add ``cdff alarms``."""
    parser = nouns.add_parser("alarms", help="alarms of all services of a running mission")
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--active", action="store_true", help="those whose cause continues (the default)")
    which.add_argument("--all", action="store_true", help="every start and end in the history, oldest first")
    parser.set_defaults(run=run_list)
    verbs = parser.add_subparsers(metavar="VERB")
    acknowledge = verbs.add_parser("ack", help="state that an operator has noticed an active alarm")
    acknowledge.add_argument("id", metavar="KIND/SOURCE", help="such as disk_full/dpm, as listed")
    acknowledge.set_defaults(run=run_acknowledge)
    for command in (parser, acknowledge):
        add_connect_option(command)
        command.add_argument("--json", action="store_true")


def run_list(args: argparse.Namespace) -> int:
    """Print one alarm, or one start or end of an alarm, a line."""
    from cdff_common.bus import Bus

    with Bus.open(args.connect, name="cdff alarms") as bus:
        items = _recorded(bus) if args.all else _call(bus, "alarms", {})["items"]
    for item in items:
        print(json.dumps(item) if args.json else _line(item))
    if not items and not args.json:
        print("no alarm has been recorded" if args.all else "no alarm is active")
    return 0


def run_acknowledge(args: argparse.Namespace) -> int:
    """Acknowledge an alarm and print it; the bus admits operators only, if it is secured."""
    from cdff_common.bus import Bus

    kind, slash, source = args.id.partition("/")
    if not (kind and slash and source):
        raise InputError(f"alarm {args.id[:80]!r}: expected KIND/SOURCE, as `cdff alarms` lists it")
    with Bus.open(args.connect, name="cdff alarms") as bus:
        alarm = _call(bus, "acknowledge", {"kind": kind, "source": source})
    print(json.dumps(alarm) if args.json else _line(alarm))
    return 0


def _call(bus: Bus, verb: str, parameters: dict[str, Any]) -> dict[str, Any]:
    from cdff_common.bus import keys

    body: dict[str, Any] = bus.call(keys.dpm_rpc(keys.GROUND, verb), parameters, timeout_s=_CALL_S).body()
    return body


def _recorded(bus: Bus) -> list[dict[str, Any]]:
    """Return the starts and ends of alarms in the history."""
    items: list[dict[str, Any]] = []
    since, more = 0, True
    while more:
        page = _call(bus, "history", {"since": since, "limit": _PAGE, "kind": "alarm"})
        items += [item | {"kind": item["alarm"]} for item in page["items"] if "alarm" in item]
        since, more = page["next"], page["more"]
    return items


def _line(alarm: dict[str, Any]) -> str:
    """Return severity, id, start, description and remedy of an alarm, and who acknowledged it."""
    from cdff_common.clock import format_stamp

    words = [f"{alarm['severity']:8}", f"{alarm['kind']}/{alarm['source']}"]
    words.append(f"since {format_stamp(alarm['since_ns'])}: {alarm['what']}; {alarm['remedy']}")
    if alarm.get("active") is False:
        words[-1] = "has ended"
    if alarm.get("acknowledged_by"):
        words.append(f"(acknowledged by {alarm['acknowledged_by']})")
    return " ".join(words)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``cdff top``: live tables of streams, DFPCs, newest products and alarms of a running mission."""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Iterator, Mapping
from typing import Any

from cdff_common.cli import add_connect_option
from cdff_common.command_table import SUMMARIES

_CALL_S = 5.0
#: ANSI sequences: clear the screen and go to its upper left corner.
_CLEAR = "\x1b[2J\x1b[H"


def register(nouns: Any) -> None:
    """Add ``cdff top``."""
    parser = nouns.add_parser(
        "top",
        help=SUMMARIES["top"],
        description="Tables of the streams of the sensors (rate against the stated one, stamp against "
        "mission time, gaps, frame, last value), of the DFPCs (state, quality, cost), their newest products "
        "and the active alarms. Repeated until Ctrl-C; exit code 1 with --once if a stream has a fault.",
    )
    parser.add_argument("--once", action="store_true", help="print the tables once")
    parser.add_argument("--json", action="store_true", help="print a JSON object per line")
    parser.add_argument("--every", metavar="S", type=float, default=1.0, help="period, seconds (default: 1)")
    add_connect_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Print the tables until Ctrl-C, or once."""
    from cdff_common.bus import Bus, keys
    from cdff_common.errors import CdffError, InputError
    from cdff_common.json_form import jsonable

    if not args.every > 0:
        raise InputError(f"--every {args.every}: expected above 0 seconds")
    is_screen = sys.stdout.isatty() and not args.once and not args.json
    with Bus.open(args.connect, name="cdff top") as bus:
        while True:
            try:
                status = bus.call(keys.dpm_rpc(keys.GROUND, "stat"), timeout_s=_CALL_S).body()
            except CdffError as error:
                if args.once:
                    raise
                text = f"the DPM does not answer: {error}"
            else:
                text = json.dumps(jsonable(selected(status))) if args.json else "\n".join(lines(status))
            print(f"{_CLEAR if is_screen else ''}{text}", flush=True)
            if args.once:
                return 1 if any(row["faults"] for row in selected(status)["streams"]) else 0
            time.sleep(args.every)


def selected(status: Mapping[str, Any]) -> dict[str, Any]:
    """Return the part of the DPM's status that is shown."""
    overview = status.get("overview") or {"streams": [], "dfpcs": [], "newest": []}
    return {"now_ns": status["now_ns"], **overview, "alarms": status["alarms"]}


def lines(status: Mapping[str, Any]) -> Iterator[str]:
    """Yield the tables as text."""
    from cdff_common.clock import format_stamp
    from cdff_common.terminal import table

    overview = selected(status)
    yield f"mission time {format_stamp(overview['now_ns'])}"
    streams = [_stream_cells(row) for row in overview["streams"]]
    yield from _titled(
        table(("stream", "mode", "Hz", "stated", "stamp", "lost", "frame", "last value, faults"), streams),
        streams,
        "no streams: the DPM has no profile",
    )
    dfpcs = [_dfpc_cells(row, overview["now_ns"]) for row in overview["dfpcs"]]
    header = ("DFPC", "state", "quality", "cores", "MB", "lag", "out", "reasons, last error")
    yield from _titled(table(header, dfpcs), dfpcs, "no DFPC answers")
    newest = [_product_cells(row, overview["now_ns"]) for row in overview["newest"]]
    yield from _titled(table(("output", "product", "age", "quality"), newest), newest, "no product yet")
    alarms = [
        (alarm["severity"], f"{alarm['kind']}/{alarm['source']}", f"{alarm['what']}; {alarm['remedy']}")
        for alarm in overview["alarms"]
    ]
    yield from _titled(table(("alarm", "kind/source", "what, remedy"), alarms), alarms, "no alarm is active")


def _titled(rows: list[str], cells: list[Any], empty: str) -> Iterator[str]:
    yield ""
    yield from rows if cells else [empty]


def _stream_cells(row: Mapping[str, Any]) -> tuple[str, ...]:
    mode = str(row["mode"]) if row["on"] or row["mode"] == "off" else f"{row['mode']} (off)"
    name = f"{row['robot']}/{row['sensor']}.{row['stream']}"
    stated_hz = f"{row['stated_hz']:g}" if row["stated_hz"] else "–"
    if "count" not in row:
        reason = "no active DFPC reads it" if not row["consumers"] else "no sample yet"
        return (name, mode, "–", stated_hz, "–", "–", "–", "; ".join([reason, *row["faults"]]))
    offset = "–" if row["offset_s"] is None else f"{row['offset_s']:+.3f} s"
    rate = "–" if row["rate_hz"] is None else f"{row['rate_hz']:.1f}"
    frame = row["frame"] + ("" if row["frame_known"] else " (unknown)")
    return (
        name,
        mode,
        rate,
        stated_hz,
        offset,
        str(row["lost"]),
        frame,
        "; ".join([*row["faults"], row["last"]]),
    )


def _dfpc_cells(row: Mapping[str, Any], now_ns: int) -> tuple[str, ...]:
    state = str(row["state"]) if row["alive"] else "not running"
    cores = "–" if row["cpu_cores"] is None else f"{row['cpu_cores']:.2f}"
    memory = "–" if row["rss_mb"] is None else f"{row['rss_mb']:.0f}"
    lag = "–" if row["oldest_ns"] is None else f"{max(now_ns - row['oldest_ns'], 0) * 1e-9:.1f} s"
    words = ", ".join(filter(None, [*row["reasons"], row["last_error"]]))
    name = f"{row['robot']}/{row['name']}"
    return (name, state, row["quality"] or "–", cores, memory, lag, str(row["outputs"] or 0), words)


def _product_cells(row: Mapping[str, Any], now_ns: int) -> tuple[str, ...]:
    age = f"{(now_ns - row['t1_ns']) * 1e-9:.1f} s"
    return (f"{row['robot']}/{row['dfpc']}.{row['port']}", row["product"] or "–", age, row["status"])

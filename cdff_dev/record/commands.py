# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff record``."""

from __future__ import annotations

import argparse
import sys
import threading
from pathlib import Path
from typing import Any

_REPORT_S = 10.0


def register(nouns: Any) -> None:
    """Add ``cdff record``."""
    parser = nouns.add_parser(
        "record", help="write the sensor samples and products on the bus to a log, until Ctrl-C"
    )
    parser.add_argument(
        "keys",
        metavar="KEYEXPR",
        nargs="*",
        help="keys of samples and products (default: all), such as 'cdff/@v1/mana/sensor/**'",
    )
    parser.add_argument(
        "--out",
        metavar="LOG",
        type=Path,
        required=True,
        help="NAME.msg, NAME.mcap, NAME.bag, or a folder for a ROS 2 bag",
    )
    parser.add_argument("--split-mb", metavar="MB", type=float, help="size after which a new file begins")
    parser.add_argument(
        "--split-s", metavar="S", type=float, help="mission time after which a new file begins"
    )
    parser.add_argument("--duration-s", metavar="S", type=float, help="end after this time")
    parser.add_argument("--connect", help="endpoint of the router (default: CDFF_CONNECT)")
    parser.set_defaults(run=_run)


def _run(args: argparse.Namespace) -> int:
    """Record samples until stopped; return the exit code."""
    from cdff_common.bus import Bus
    from cdff_common.errors import InputError
    from cdff_common.process import stop_event
    from cdff_dev.record.files import RecordingFiles
    from cdff_dev.record.recorder import DEFAULT_KEYS, Recorder

    if args.duration_s is not None and not args.duration_s > 0.0:
        raise InputError(f"--duration-s {args.duration_s}: expected above 0")
    max_bytes = None if args.split_mb is None else args.split_mb * 1e6
    keys, stop = args.keys or DEFAULT_KEYS, stop_event()
    with Bus.open(args.connect, name="record") as bus:
        files = RecordingFiles(args.out, max_bytes, args.split_s)
        recorder = Recorder(bus, keys, files, on_fault=stop.set)
        _say(f"recording {', '.join(keys)} to {args.out}; Ctrl-C ends it")
        try:
            _wait(stop, args.duration_s, lambda: _say(f"{recorder.samples} samples"))
        finally:
            recorded = recorder.close()
    for stream, count in sorted(recorded.by_stream.items()):
        print(f"{stream}: {count}")
    for (stream, loss), count in sorted(files.losses.items()):
        print(f"not held: {stream}: {loss} ({count} samples)")
    print(
        f"{recorded.by_stream.total()} samples, {recorded.size / 1e6:.1f} MB, {recorder.dropped} dropped, "
        f"{recorded.refused.total()} refused; wrote {', '.join(str(path) for path in files.paths)}"
    )
    return 0


def _wait(stop: threading.Event, duration_s: float | None, report: Any) -> None:
    """Wait for ``stop`` or the end of the duration; report every ten seconds."""
    remaining_s = float("inf") if duration_s is None else duration_s
    while remaining_s > 0 and not stop.wait(min(remaining_s, _REPORT_S)):
        remaining_s -= _REPORT_S
        if remaining_s > 0:
            report()


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)

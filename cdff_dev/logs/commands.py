# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Command line of ``cdff log``: show, cut, merge, convert, compare and export logs."""

from __future__ import annotations

import argparse
import base64
import heapq
import json
import logging
import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cdff_dev.logs.conversion_commands import add_span, register_conversions

if TYPE_CHECKING:
    from cdff_dev.logs.source import LogSample, LogSource

#: Largest number of elements of a list that are printed as text.
_SHOWN_ITEMS = 4
_LOG_HELP = (
    "file, folder or pattern of files: InFuse .msg, pocolog .log, ROS bag, MCAP, KITTI, images, scans …"
)


def register(nouns: Any) -> None:
    """Add the parser of ``cdff log``."""
    parser = nouns.add_parser("log", help="show, cut, merge, convert, compare and export logs")
    parser.set_defaults(help_parser=parser)  # prints its help if no verb is given
    verbs = parser.add_subparsers(metavar="VERB")

    info = verbs.add_parser("info", help="streams, types, counts, times, and deviations from the format")
    _add_log(info)
    info.add_argument("--json", action="store_true", help="print JSON")
    info.add_argument("--map", action="store_true", help="print the default map of cdff log convert")
    info.add_argument("--deep", action="store_true", help="also decode every sample")
    info.set_defaults(run=_info)

    cat = verbs.add_parser(
        "cat",
        help="print samples, one per line, in the order of their stamps",
        description="Prints samples, one per line, in the order of their stamps; also content that has no "
        "type of CDFF but is decoded, with the names in cdff log info.",
    )
    _add_log(cat)
    _add_selection(cat)
    cat.add_argument("--limit", type=int, metavar="N", help="stop after N samples")
    cat.add_argument("--json", action="store_true", help="print all fields as JSON")
    cat.set_defaults(run=_cat)

    cut = verbs.add_parser("cut", help="copy some streams or a time interval into a new log")
    _add_log(cut)
    cut.add_argument("--out", required=True, metavar="LOG", help="NAME.msg, or a folder for chunks")
    _add_selection(cut)
    cut.set_defaults(run=_cut)

    merge = verbs.add_parser("merge", help="merge several logs into one, in the order of their stamps")
    merge.add_argument("logs", nargs="+", metavar="LOG", help=_LOG_HELP)
    merge.add_argument("--out", required=True, metavar="LOG", help="NAME.msg, or a folder for chunks")
    merge.set_defaults(run=_merge)
    register_conversions(verbs)


def _add_log(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help=_LOG_HELP)
    parser.add_argument(
        "--calibration", metavar="FILE", type=Path, help="calibration of the cameras, for logs without one"
    )


def _add_selection(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--stream", action="append", metavar="NAME", help="only this stream; may be repeated")
    parser.add_argument("--t0", metavar="TIME", help="earliest stamp: nanoseconds or RFC 3339")
    parser.add_argument("--t1", metavar="TIME", help="latest stamp")
    add_span(parser)


def _selected_samples(log: LogSource, args: argparse.Namespace, *, with_others: bool = False) -> Any:
    """Yield the samples of the streams and the time interval in the arguments."""
    from cdff_common.clock import parse_stamp
    from cdff_dev.logs.conversion import TimeSpan
    from cdff_dev.logs.source import chosen_streams

    t0 = None if args.t0 is None else parse_stamp(args.t0, "--t0")
    t1 = None if args.t1 is None else parse_stamp(args.t1, "--t1")
    if args.start or args.duration is not None:
        parts = [part for part in (log, log.others if with_others else None) if part is not None]
        infos = {name: info for part in parts for name, info in part.streams.items()}
        chosen = [infos[name] for name in chosen_streams(infos, args.stream)]
        start_ns, end_ns = TimeSpan(args.start, args.duration).interval_ns(chosen)
        t0 = start_ns if t0 is None else max(t0, start_ns)
        t1 = t1 if end_ns is None else end_ns - 1 if t1 is None else min(t1, end_ns - 1)
    for sample in _samples_and_others(log, args.stream) if with_others else log.samples(args.stream):
        if t0 is not None and sample.stamp_ns < t0:
            continue
        if t1 is not None and sample.stamp_ns > t1:
            break
        yield sample


def _samples_and_others(log: LogSource, names: list[str] | None) -> Iterator[LogSample]:
    """Yield the samples of streams and of content without a stream that is decoded, all without names."""
    from cdff_dev.logs.source import chosen_streams

    parts = [part for part in (log, log.others) if part is not None]
    known = [name for part in parts for name in part.streams]
    chosen = set(chosen_streams(known, names))
    samples_of_parts = [part.samples(chosen & part.streams.keys()) for part in parts]
    return heapq.merge(*samples_of_parts, key=lambda s: (s.stamp_ns, s.stream, s.seq))


def _count(*logs: LogSource) -> int:
    return sum(info.count for log in logs for info in log.streams.values())


def _info(args: argparse.Namespace) -> int:
    """Print the streams of a log; return the exit code."""
    from cdff_common.progress import counted, elapsed
    from cdff_dev.logs import LogReader
    from cdff_dev.logs.content import describe
    from cdff_dev.logs.formats import LogLocation, is_log
    from cdff_dev.logs.information import size_bytes, stream_reports
    from cdff_dev.logs.mapping import map_text, topic_map
    from cdff_dev.logs.opened import opened

    location = LogLocation.of(args.log)
    if not is_log(location) and (content := describe(location)) is not None:
        print(json.dumps({"streams": {}, "content": content}) if args.json else f"no recording: {content}")
        return 0
    with ExitStack() as stack:
        if args.json:  # the quirks are in the JSON
            logger = logging.getLogger("cdff_dev.logs")
            stack.callback(logger.setLevel, logger.level)
            logger.setLevel(logging.ERROR)
        log = stack.enter_context(opened(args.log, args.calibration))
        if args.map:
            print(map_text(log.streams, topic_map(log.streams)))
            return 0
        others = {} if log.others is None else log.others.streams
        if args.deep:
            total = _count(log) + sum(info.count for info in others.values())
            for _ in counted(_samples_and_others(log, None), total, "samples"):
                pass
        with elapsed("reading the stamps"):
            reports = stream_reports(log)
        if args.json:
            document = {
                "streams": {name: report.to_json() for name, report in reports.items()},
                "quirks": dict(log.quirks.counts) if isinstance(log, LogReader) else {},
                "unconverted": {
                    name: {**asdict(item), "decoded": name in others}
                    for name, item in log.unconverted.items()
                },
                "bytes": size_bytes(args.log),
            }
            print(json.dumps(document))
            return 0
        width = max((len(name) for name in reports), default=0)
        for name, report in reports.items():
            print("\n".join(report.text(name.ljust(width))))
        for name, item in log.unconverted.items():
            note = "; cdff log cat prints it" if name in others else ""
            print(f"not converted: {name}  {item.type_name} {item.count:8d}  {item.reason}{note}")
        if not any(report.info.count for report in reports.values()):
            print("no samples: the recording is empty, or none of its content is converted")
        print(f"{size_bytes(args.log) / 1e6:.1f} MB")
    return 0


def _cat(args: argparse.Namespace) -> int:
    """Print samples of a log, a line each; return the exit code."""
    from cdff_common.clock import format_stamp
    from cdff_dev.logs.opened import opened

    with opened(args.log, args.calibration) as log:
        for i, sample in enumerate(_selected_samples(log, args, with_others=True)):
            if args.limit is not None and i >= args.limit:
                break
            if args.json:
                print(json.dumps(_as_json(sample), allow_nan=False))
            else:
                print(f"{format_stamp(sample.stamp_ns)} {sample.stream} #{sample.seq} {_text(sample.value)}")
    return 0


def _text(value: Any) -> str:
    """Return a value in one line: a message, or decoded content without a type of CDFF."""
    from cdff_common.types.summary import brief

    if isinstance(value, dict):
        return "{" + ", ".join(f"{name}: {_text(item)}" for name, item in value.items()) + "}"
    if isinstance(value, list):
        items = ", ".join(map(_text, value[:_SHOWN_ITEMS]))
        return f"[{items}{f', … {len(value)} in all' if len(value) > _SHOWN_ITEMS else ''}]"
    return brief(value)


def _as_json(sample: LogSample) -> dict[str, Any]:
    """Return a sample for JSON: NaN as null, infinities as text, bytes in base 64."""
    from cdff_common.codecs.dict_form import to_dict_form
    from cdff_common.types.message import Message

    line = {
        "stream": sample.stream,
        "type": sample.type_name,
        "stamp_ns": str(sample.stamp_ns),
        "seq": sample.seq,
        "value": _jsonable(to_dict_form(sample.value) if isinstance(sample.value, Message) else sample.value),
    }
    if sample.header is not None:
        line["header"] = _jsonable(sample.header.to_dict())
    return line


def _jsonable(value: Any) -> Any:
    """Return a value as JSON data: bytes as base64, NaN as null, infinite numbers as text."""
    if isinstance(value, dict):
        return {k: _jsonable(v) for k, v in value.items()}
    if hasattr(value, "tolist"):  # an array
        return _jsonable(value.tolist())
    if isinstance(value, list):
        return [_jsonable(v) for v in value]
    if isinstance(value, bytes):
        return base64.b64encode(value).decode("ascii")
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else str(value)
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode("utf-8")
    return value


def _cut(args: argparse.Namespace) -> int:
    """Write selected samples to a new log; return the exit code."""
    from cdff_common.progress import counted
    from cdff_dev.logs import LogWriter
    from cdff_dev.logs.opened import opened
    from cdff_dev.logs.sinks import refuse_own_input

    with opened(args.log, args.calibration) as log:
        refuse_own_input(log, Path(args.out))
        with LogWriter(args.out, is_whole=True) as writer:
            count = 0
            for sample in counted(_selected_samples(log, args), 0, "samples"):
                writer.write(sample.stream, sample.value, sample.stamp_ns, sample.header)
                count += 1
    print(f"{args.out}: {count} samples")
    return 0


def _merge(args: argparse.Namespace) -> int:
    """Write the samples of several logs to one, in order of time; return the exit code."""
    from cdff_common.errors import InputError
    from cdff_common.progress import counted
    from cdff_dev.logs import LogWriter
    from cdff_dev.logs.opened import opened
    from cdff_dev.logs.sinks import refuse_own_input

    with ExitStack() as stack:
        logs = []
        path_of: dict[str, str] = {}
        for path in args.logs:
            log = stack.enter_context(opened(path))
            refuse_own_input(log, Path(args.out))
            for name in log.streams:
                if name in path_of:
                    raise InputError(
                        f"stream {name} is in {path_of[name]} and in {path}: cut it out of one of them first"
                    )
                path_of[name] = path
            logs.append(log)
        ordered = heapq.merge(*(log.samples() for log in logs), key=lambda s: (s.stamp_ns, s.stream, s.seq))
        with LogWriter(args.out, is_whole=True) as writer:
            for sample in counted(ordered, _count(*logs), "samples"):
                writer.write(sample.stream, sample.value, sample.stamp_ns, sample.header)
        print(f"{args.out}: {_count(*logs)} samples of {len(path_of)} streams")
    return 0

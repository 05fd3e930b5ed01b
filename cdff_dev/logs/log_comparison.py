# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Differences between two logs of any formats."""

from __future__ import annotations

from itertools import zip_longest

from cdff_common.clock import format_stamp
from cdff_dev.logs.differences import EXACT, differing_fields
from cdff_dev.logs.source import LogSample, LogSource


def log_differences(a: LogSource, b: LogSource, tolerance: tuple[float, float] = EXACT) -> list[str]:
    """Return one line for each difference: streams of one log, types, counts, and first different values.

    Parameters
    ----------
    a, b : LogSource
    tolerance : tuple of float
        Relative and absolute difference up to which numbers are equal.

    Raises
    ------
    CodecError
        If a sample cannot be read.
    """
    lines = [f"{name}: only in the first log" for name in a.streams if name not in b.streams]
    lines += [f"{name}: only in the second log" for name in b.streams if name not in a.streams]
    for name in (name for name in a.streams if name in b.streams):
        first, second = a.streams[name], b.streams[name]
        if first.type_name != second.type_name:
            lines.append(f"{name}: type {first.type_name} and {second.type_name}")
            continue
        if first.count != second.count:
            lines.append(f"{name}: {first.count} and {second.count} samples")
        lines += _first_difference(a, b, name, tolerance)
    return lines


def _first_difference(a: LogSource, b: LogSource, name: str, tolerance: tuple[float, float]) -> list[str]:
    """Return a line about the first different sample of a stream; empty if all are equal."""
    for x, y in zip_longest(a.samples([name]), b.samples([name])):
        if x is None or y is None:
            sample, which = (y, "second") if x is None else (x, "first")
            return [f"{name}: sample at {_stamp(sample)} only in the {which} log"]
        if x.stamp_ns != y.stamp_ns:
            return [f"{name}: sample {x.seq} at {_stamp(x)} and {_stamp(y)}"]
        if paths := differing_fields(x.value, y.value, tolerance):
            return [f"{name}: first different value at {_stamp(x)}: {', '.join(paths)}"]
    return []


def _stamp(sample: LogSample) -> str:
    return format_stamp(sample.stamp_ns)

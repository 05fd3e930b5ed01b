# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stamps of the files of a folder: from ``times.txt``, from their names, or at a constant rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError

#: Period of files without times: that of the sweeps of KITTI.
PERIOD_NS = 100_000_000
#: Nanoseconds of the last digit of a number that is a time since 1970, by the number of its digits.
_UNITS_NS = {10: 1_000_000_000, 13: 1_000_000, 16: 1_000, 19: 1}
_NUMBER = re.compile(r"\d+")
_TIME = re.compile(r"(\d{10})\.(\d{1,9})$")
#: Date and time in UTC, as in ``20140805T200719``.
_DATE = re.compile(r"(?<!\d)(\d{8}T\d{6})(?!\d)")


def natural_order(file: Path) -> tuple[list[int], str]:
    """Return a key that orders files by the numbers in their names: ``scan2`` before ``scan10``."""
    return [int(number) for number in _NUMBER.findall(file.stem)], file.name


def file_stamps(files: Sequence[Path], times: Path | None = None) -> NDArray[np.int64]:
    """Return the stamps of files, which are in the order of time.

    Parameters
    ----------
    files : sequence of Path
    times : Path, optional
        A file with one time per line, in seconds. Without it, a name that is a time since 1970 in seconds
        (also with decimals), milliseconds, microseconds or nanoseconds is the stamp, also before the number
        of a camera (``1403715273262142976_0``), and so is a date and time in UTC such as ``20140805T200719``;
        other last numbers of the names, if they ascend, are numbers of periods of 100 ms; else the files are
        100 ms apart.

    Raises
    ------
    InputError
        If the stamps do not ascend, or ``times`` has too few.
    """
    stamps_ns = _from_file(times, len(files)) if times is not None else _from_names(files)
    stamps_ns = np.round(stamps_ns / 1000).astype(np.int64) * 1000 if len(stamps_ns) else stamps_ns
    if np.any(np.diff(stamps_ns) <= 0):
        at = int(np.argmax(np.diff(stamps_ns) <= 0)) + 1
        raise InputError(f"{times or files[at]}: the time of number {at} is not after the one before it")
    return stamps_ns


def _from_file(path: Path, count: int) -> NDArray[np.int64]:
    """Return the stamps (n,) in a file with one time in seconds on each line."""
    words = path.read_text(encoding="utf-8", errors="replace").split()
    try:
        seconds = np.array([float(word) for word in words[:count]])
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected one time in seconds a line") from error
    if len(seconds) < count or not np.isfinite(seconds).all():
        raise InputError(f"{path}: {len(words)} times for {count} files, expected one each")
    return np.round(seconds * 1e6).astype(np.int64) * 1000


def _from_names(files: Sequence[Path]) -> NDArray[np.int64]:
    """Return the stamps (n,) in file names: times, dates or numbers; without them, multiples of a period."""
    times = [_TIME.match(file.stem) for file in files]
    if times and all(times):
        return np.array([int(m[1]) * 10**9 + int(m[2].ljust(9, "0")) for m in times if m], np.int64)
    dates = [_DATE.search(file.stem) for file in files]
    if dates and all(dates):
        return np.array([_seconds(match[1]) * 10**9 for match in dates if match], np.int64)
    numbers = [_NUMBER.findall(file.stem) for file in files]
    if not all(numbers):
        return np.arange(len(files), dtype=np.int64) * PERIOD_NS
    last_numbers = [_time_or_last(numbers_of_name) for numbers_of_name in numbers]
    lengths = {len(number) for number in last_numbers}
    unit_ns = _UNITS_NS.get(lengths.pop()) if len(lengths) == 1 else None
    counts = [int(number) for number in last_numbers]
    is_counter = unit_ns is None and all(a < b for a, b in pairwise(counts))
    if max(counts, default=0) > np.iinfo(np.int64).max // (unit_ns or PERIOD_NS):
        is_counter, unit_ns = False, None
    if unit_ns is None and not is_counter:
        return np.arange(len(files), dtype=np.int64) * PERIOD_NS
    return np.array(counts, dtype=np.int64) * (unit_ns or PERIOD_NS)


def _time_or_last(numbers: Sequence[str]) -> str:
    """Return the last of the numbers in a name that has the digits of a time, else the last number."""
    return next((n for n in reversed(numbers) if len(n) in _UNITS_NS), numbers[-1])


def _seconds(text: str) -> int:
    """Return the seconds since 1970 of a date and time; raises InputError for an impossible one."""
    try:
        return int(datetime.strptime(text, "%Y%m%dT%H%M%S").replace(tzinfo=UTC).timestamp())
    except ValueError as error:
        raise InputError(f"date {text!r} in a file name: {error}") from error

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stamps of the files of a folder: from ``times.txt``, from their names, or at a constant rate."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cdff_common.errors import InputError

#: Period without times, as of KITTI.
PERIOD_NS = 100_000_000
#: Nanoseconds of the last digit of a number that is a time since 1970, by the number of its digits.
_UNITS_NS = {10: 1_000_000_000, 13: 1_000_000, 16: 1_000, 19: 1}
_NUMBER = re.compile(r"\d+")
_TIME = re.compile(r"(\d{10})\.(\d{1,9})$")


def file_stamps(files: Sequence[Path], times: Path | None = None) -> NDArray[np.int64]:
    """Return the stamps of files, which are in the order of their names.

    Parameters
    ----------
    files : sequence of Path
    times : Path, optional
        A file with one time a line, in seconds. Without it, a name that is a time since 1970 in seconds (also
        with decimals), milliseconds, microseconds or nanoseconds is the stamp; a name that ends with another
        number is that number of periods of 100 ms; else the files are 100 ms apart.

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
    words = path.read_text(encoding="utf-8", errors="replace").split()
    try:
        seconds = np.array([float(word) for word in words[:count]])
    except ValueError as error:
        raise InputError(f"{path}: {error}; expected one time in seconds a line") from error
    if len(seconds) < count or not np.isfinite(seconds).all():
        raise InputError(f"{path}: {len(words)} times for {count} files, expected one each")
    return np.round(seconds * 1e6).astype(np.int64) * 1000


def _from_names(files: Sequence[Path]) -> NDArray[np.int64]:
    times = [_TIME.match(file.stem) for file in files]
    if times and all(times):
        return np.array([int(m[1]) * 10**9 + int(m[2].ljust(9, "0")) for m in times if m], np.int64)
    numbers = [_NUMBER.findall(file.stem) for file in files]
    if not all(numbers):
        return np.arange(len(files), dtype=np.int64) * PERIOD_NS
    last = [found[-1] for found in numbers]
    lengths = {len(number) for number in last}
    unit_ns = _UNITS_NS.get(lengths.pop(), PERIOD_NS) if len(lengths) == 1 else PERIOD_NS
    if max(map(int, last), default=0) > np.iinfo(np.int64).max // unit_ns:
        return np.arange(len(files), dtype=np.int64) * PERIOD_NS
    return np.array([int(number) * unit_ns for number in last], dtype=np.int64)

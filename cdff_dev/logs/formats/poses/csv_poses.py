# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Poses in CSV files with named columns, such as the ground truth of EuRoC (ASL data sets)."""

from __future__ import annotations

import re
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from cdff_common.formats.file_source import Source
from cdff_common.geometry import se3
from cdff_dev.logs.tables import time_unit_ns

_MAX_NS = int(np.iinfo(np.int64).max) - 1000

#: Columns of a pose, and the patterns of their names: p_RS_R_x [m], tx_m, x; q_RS_w [], qw.
_COLUMNS = {
    "time": r"timestamp.*|time.*|stamp.*|t(_[mun]?s)?",
    **{axis: rf"(p_.*_|t|p|position_)?{axis}(_m)?" for axis in "xyz"},
    **{f"q{part}": rf"q(_.*_|_)?{part}" for part in "xyzw"},
}


def is_pose_csv(source: Source) -> bool:
    """Return whether the first line names the columns of poses, separated by commas."""
    return len(_columns(_header(source))) == len(_COLUMNS)


def read_pose_csv(source: Source) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Read stamps ``(n,)`` in nanoseconds, and matrices ``(n, 4, 4)``; raises CodecError with the line.

    The unit of the times is that of the name of their column, or of their size (see ``time_unit_ns``).
    """
    header = _header(source)
    columns = _columns(header)
    times: list[tuple[int, str]] = []
    rows = []
    lines = source.data.decode("utf-8", "replace").splitlines()
    for number, line in enumerate(lines[1:], start=2):
        words = line.split("#")[0].split(",")
        if len(words) == 1 and not words[0].strip():
            continue
        try:
            times.append((number, words[columns["time"]].strip()))
            rows.append([float(words[columns[name]]) for name in ("x", "y", "z", "qx", "qy", "qz", "qw")])
        except (ValueError, IndexError) as error:
            raise source.error(f"line {number}: {error}; expected {', '.join(header)}") from error
    table = np.array(rows, dtype=np.float64).reshape(-1, 7)
    if not (np.isfinite(table).all() and (np.abs(np.linalg.norm(table[:, 3:], axis=1) - 1.0) < 0.01).all()):
        raise source.error("a pose is not finite or its quaternion is not of unit length")
    T = se3.transform_from_quaternion_xyzw(table[:, :3], table[:, 3:]) if len(table) else np.zeros((0, 4, 4))
    unit_ns = time_unit_ns(header[columns["time"]], [word for _, word in times])
    return np.array([_stamp_ns(source, *time, unit_ns) for time in times], dtype=np.int64), T


def _stamp_ns(source: Source, number: int, word: str, unit_ns: int) -> int:
    """Return the time of a line in nanoseconds; raises CodecError if it is not a number before 2262."""
    try:
        stamp_ns = Decimal(word) * unit_ns
        is_time = abs(stamp_ns) <= _MAX_NS
    except ArithmeticError:
        is_time = False
    if not is_time:
        raise source.error(f"line {number}: time {word!r}, expected one before 2262 in units of {unit_ns} ns")
    return int(stamp_ns)


def _header(source: Source) -> list[str]:
    first = source.data[:4096].split(b"\n", 1)[0].decode("utf-8", "replace")
    return [word.strip() for word in first.lstrip("#\ufeff").split(",")] if "," in first else []


def _columns(header: list[str]) -> dict[str, int]:
    """Return the index of each column of a pose that the header names; the first one if several match."""
    names = [re.sub(r"\s*\[.*\]", "", name).strip() for name in header]
    index_by_column: dict[str, int] = {}
    for column, pattern in _COLUMNS.items():
        for index, name in enumerate(names):
            if re.fullmatch(pattern, name, re.IGNORECASE):
                index_by_column.setdefault(column, index)
    return index_by_column

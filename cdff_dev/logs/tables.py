# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Text tables of data sets: a time, then numbers, separated by commas or blanks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from decimal import Decimal, InvalidOperation
from pathlib import Path

import numpy as np

from cdff_common.errors import InputError
from cdff_common.geometry import se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.image_streams import Stamps

_SEPARATOR = re.compile(r"[,\s]+")
_UNITS_NS = {"s": 1_000_000_000, "ms": 1_000_000, "us": 1_000, "ns": 1}
_TIME_UNIT = re.compile(r"[\[(_](s|ms|us|ns)(?:ec)?[\])]?$")
#: Times since 1970 are between this time (in 2001) and its tenfold; integers below a million are seconds.
_FIRST_DATE_S, _MAX_WHOLE_S = 1e9, 1e6
_NUMBER = re.compile(r"[+-]?\d+(\.\d*)?(e[+-]?\d{1,2})?", re.IGNORECASE)
_MAX_NS = int(np.iinfo(np.int64).max) - 1000
#: Largest deviation of the length of a quaternion from 1: files have few digits.
_QUATERNION_TOLERANCE = 0.01


def read_rows(path: Path, columns: int) -> list[tuple[int, list[str]]]:
    """Return number and words of each line, without comments (``#``), empty lines and a first line of names.

    Raises
    ------
    InputError
        With file and line, if a line has fewer than ``columns`` words, or there is no line.
    """
    rows = []
    for number, line in enumerate(path.read_text(encoding="utf-8", errors="replace").splitlines(), 1):
        words = _SEPARATOR.split(line.strip())
        if line.startswith("#") or not line.strip() or (number == 1 and words[0][:1].isalpha()):
            continue
        if len(words) < columns:
            raise InputError(f"{path}:{number}: {len(words)} columns, expected at least {columns}")
        rows.append((number, words))
    if not rows:
        raise InputError(f"{path}: empty, expected lines of {columns} columns")
    return rows


def read_times(path: Path, rows: list[tuple[int, list[str]]], unit_ns: int) -> Stamps:
    """Return the stamps (n,) of the first words of rows, in units of ``unit_ns``, rounded to microseconds.

    Raises
    ------
    InputError
        With file and line, if a word is not a time from 1970 to 2262.
    """
    stamps_ns = []
    for number, words in rows:
        try:
            stamp_ns = Decimal(words[0]) * unit_ns
            if not 0 <= stamp_ns <= _MAX_NS:
                raise InvalidOperation
        except ArithmeticError:
            raise InputError(f"{path}:{number}: {words[0]!r}, expected a time since 1970") from None
        stamps_ns.append((int(stamp_ns) + 500) // 1000 * 1000)
    return np.array(stamps_ns, np.int64)


def time_unit_ns(name: str, words: Sequence[str]) -> int:
    """Return the nanoseconds of a time of 1 in a column.

    They are those of the unit at the end of its name, such as ``time [ms]`` or ``t_s``. Without one, the
    times are in the unit in which all of them are a date from 2001 to 2286; if there is none, they are
    seconds if one has a decimal point or all are below a million, otherwise nanoseconds. Words that are no
    numbers do not count.
    """
    if unit_match := _TIME_UNIT.search(name.strip().lower()):
        return _UNITS_NS[unit_match[1]]
    numbers = [float(word) for word in words if _NUMBER.fullmatch(word.strip())] or [0.0]
    smallest_s, largest_s = min(numbers) * 1e-9, max(numbers) * 1e-9
    for unit_ns in _UNITS_NS.values():
        if smallest_s * unit_ns >= _FIRST_DATE_S and largest_s * unit_ns < 10 * _FIRST_DATE_S:
            return unit_ns
    has_decimals = any("." in word for word in words)
    return _UNITS_NS["s"] if has_decimals or max(numbers) < _MAX_WHOLE_S else _UNITS_NS["ns"]


def read_table(path: Path, columns: int, unit_ns: int) -> tuple[Stamps, FloatArray]:
    """Return the stamps (n,) and the following ``columns`` finite numbers (n, columns) of a table.

    Parameters
    ----------
    unit_ns : int
        Nanoseconds of a time of 1.

    Raises
    ------
    InputError
        With file and line, for a line of other content.
    """
    rows = read_rows(path, columns + 1)
    values = np.empty((len(rows), columns))
    for i, (number, words) in enumerate(rows):
        try:
            values[i] = [float(word) for word in words[1 : columns + 1]]
        except ValueError as error:
            raise InputError(f"{path}:{number}: {error}") from error
        if not np.isfinite(values[i]).all():
            raise InputError(f"{path}:{number}: {' '.join(words)}, expected finite numbers")
    return read_times(path, rows, unit_ns), values


def poses_of_rows(path: Path, rows: FloatArray, *, scalar_first: bool = False) -> FloatArray:
    """Return the poses ``(n, 4, 4)`` of rows with a position in metres and a quaternion.

    Raises
    ------
    InputError
        If the length of a quaternion is not 1 within 1 %.
    """
    q_xyzw = rows[:, [4, 5, 6, 3]] if scalar_first else rows[:, 3:7]
    deviations = np.abs(np.linalg.norm(q_xyzw, axis=1) - 1.0)
    if deviations.max() > _QUATERNION_TOLERANCE:
        worst = int(deviations.argmax())
        raise InputError(f"{path}: row {worst + 1}: quaternion {q_xyzw[worst].tolist()}, expected length 1")
    return se3.transform_from_quaternion_xyzw(rows[:, :3], q_xyzw)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CSV files with named columns of accelerations and angular rates as logs.

Recognised names, in any order, are those of EuRoC (``w_RS_S_x``, ``a_RS_S_x``), of exported ROS messages
(``angular_velocity.x``, ``linear_acceleration.x``), and ``gx``, ``gyro_x``, ``wx``, ``omega_x`` with ``ax``,
``acc_x``, ``accel_x``. A unit in brackets is that of the column: ``[rad/s]`` or ``[deg/s]``, ``[m/s^2]`` or
``[g]``; without one they are rad/s and m/s2. The unit of the times is that of the name of their column, or of
their size (see ``time_unit_ns``).
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cdff_common.contract.foreign_names import robot_name
from cdff_common.errors import InputError
from cdff_common.geometry.se3 import FloatArray
from cdff_common.types import IMUSensors, Time
from cdff_dev.logs.image_streams import Stamps
from cdff_dev.logs.indexed import IndexedLog, IndexedStream, headers
from cdff_dev.logs.source import Unconverted
from cdff_dev.logs.tables import read_times, time_unit_ns

_STANDARD_GRAVITY = 9.80665  # m/s2
_NAMES = {
    "time": r"#?\s*(timestamp|time|stamp|t)(_?n?s(ec)?)?",
    **{f"a{i}": rf"a(cc(el(eration)?)?)?(_rs_s)?_?{i}|linear_acceleration[._]{i}" for i in "xyz"},
    **{f"w{i}": rf"(w|g(yro?)?|omega)(_rs_s)?_?{i}|angular_velocity[._]{i}" for i in "xyz"},
}
_UNIT = re.compile(r"[\[(](.*)[\])]")
_FACTORS = {"g": _STANDARD_GRAVITY, "deg": np.pi / 180.0}


@dataclass(frozen=True, slots=True)
class Columns:
    """Columns of a table: index and factor of each quantity, the name of the time, the other names."""

    index: dict[str, int]
    factor: dict[str, float]
    time_name: str
    others: list[str]


def columns_of(head: bytes) -> Columns | None:
    """Return the columns that the first line of a table names; None if not all seven are among them."""
    first = head.split(b"\n", 1)[0].decode("utf-8", "replace").lstrip("\ufeff").strip()
    names = [name.strip() for name in first.split(",")]
    index: dict[str, int] = {}
    factor: dict[str, float] = {}
    for at, name in enumerate(names):
        unit = unit_match.group(1).strip().lower() if (unit_match := _UNIT.search(name)) else ""
        plain = _UNIT.sub("", name).strip().lower()
        quantity = next((q for q, pattern in _NAMES.items() if re.fullmatch(pattern, plain)), None)
        if quantity is not None and quantity not in index:
            index[quantity] = at
            factor[quantity] = next((f for prefix, f in _FACTORS.items() if unit.startswith(prefix)), 1.0)
    if len(index) < len(_NAMES):
        return None
    others = [name for at, name in enumerate(names) if at not in index.values()]
    return Columns(index, factor, names[index["time"]], others)


def imu_log(path: Path) -> IndexedLog:
    """Open a table as the stream ``/{robot}/imu.imu`` in the frame ``{robot}/imu``.

    The robot has the name of the file. Columns of other names are listed as not converted.

    Raises
    ------
    InputError
        With file and line, if a line has other content than finite numbers and a time since 1970.
    """
    columns = columns_of(path.read_bytes()[:4096])
    if columns is None:
        raise InputError(f"{path}: expected columns for time, acceleration and angular rate")
    stamps_ns, rows = _read(path, columns)
    robot = robot_name(path)
    name, frame = f"/{robot}/imu.imu", f"{robot}/imu"

    def read(i: int) -> IMUSensors:
        return IMUSensors(Time.from_ns(int(stamps_ns[i])), rows[i, 3:6], rows[i, :3], np.zeros(3))

    header = headers(name, stamps_ns, frame=frame, producer=frame)
    others = {n: Unconverted("column", len(rows), "no acceleration or angular rate") for n in columns.others}
    return IndexedLog({name: IndexedStream("IMUSensors", stamps_ns, read, header)}, others)


def _read(path: Path, columns: Columns) -> tuple[Stamps, FloatArray]:
    """Return the stamps, and rows of angular rates, rad/s, and specific forces, m/s2."""
    order = [f"{kind}{axis}" for kind in "wa" for axis in "xyz"]
    times: list[tuple[int, list[str]]] = []
    rows: list[list[float]] = []
    with path.open(encoding="utf-8", errors="replace", newline="") as file:
        lines = csv.reader(file)
        next(lines)
        try:
            for words in lines:
                if not any(word.strip() for word in words):
                    continue
                times.append((lines.line_num, [words[columns.index["time"]].strip()]))
                rows.append([float(words[columns.index[q]]) * columns.factor[q] for q in order])
        except (ValueError, IndexError, csv.Error) as error:
            raise InputError(f"{path}:{lines.line_num}: {error}; expected numbers in all columns") from error
    table = np.array(rows, dtype=np.float64).reshape(-1, len(order))
    if bad := np.flatnonzero(~np.isfinite(table).all(axis=1)).tolist():
        raise InputError(f"{path}:{times[bad[0]][0]}: a number that is not finite; remove the line")
    unit_ns = time_unit_ns(columns.time_name, [words[0] for _, words in times])
    return read_times(path, times, unit_ns), table

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Tables of an inertial measurement unit: CSV files with named columns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog

#: Number of bytes at the start of a file in which the line with the names of the columns is expected.
_HEAD_BYTES = 4096


def _recognises(location: LogLocation) -> bool:
    """Return whether a file is a table with columns of an IMU."""
    if len(location.files) != 1 or location.files[0].suffix.lower() not in (".csv", ".txt"):
        return False
    from cdff_dev.logs.formats.imu_table.table import columns_of

    return columns_of(location.head(_HEAD_BYTES)) is not None


def _open(location: LogLocation, _: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.imu_table.table import imu_log

    return imu_log(location.files[0])


FORMAT = LogFormat(
    "IMU table", "a .csv file with columns for time, acceleration and angular rate", _recognises, _open
)

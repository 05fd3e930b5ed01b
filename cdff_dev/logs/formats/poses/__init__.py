# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Files of poses: TUM, KITTI, and tables with named columns."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog

_SUFFIXES = (".tum", ".txt", ".csv")
#: Number of bytes at the start of a file by which the format of poses is recognised.
_HEAD_BYTES = 1 << 16


def _recognises(location: LogLocation) -> bool:
    """Return whether a file is a table of poses."""
    if len(location.files) != 1 or location.files[0].suffix.lower() not in _SUFFIXES:
        return False
    from cdff_common.formats.file_source import Source
    from cdff_dev.logs.formats.poses.pose_files import pose_format

    return pose_format(Source(location.head(_HEAD_BYTES), location.name)) is not None


def _open(location: LogLocation, _: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.poses.pose_files import poses_log

    return poses_log(location.files[0])


FORMAT = LogFormat(
    "poses", "a TUM file, a KITTI pose file, or a .csv with named columns of poses", _recognises, _open
)

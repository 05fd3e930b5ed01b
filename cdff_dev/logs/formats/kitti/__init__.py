# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Sequences in the layout of the KITTI odometry benchmark, and drives of the KITTI raw recordings."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog


def _is_kitti(location: LogLocation) -> bool:
    """Return whether a folder is a raw recording or a sequence of KITTI."""
    if location.folder is None:
        return False
    from cdff_dev.logs.formats.kitti.raw import is_raw
    from cdff_dev.logs.formats.kitti.sequence import is_kitti

    return is_raw(location.folder) or is_kitti(location.folder)


def _open(location: LogLocation, calibration: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.kitti.raw import is_raw, raw_log
    from cdff_dev.logs.formats.kitti.sequence import kitti_log

    assert location.folder is not None
    if is_raw(location.folder):
        return raw_log(location.folder, calibration)
    return kitti_log(location.folder, calibration)


FORMAT = LogFormat(
    "KITTI sequence",
    "a folder with image_0 and image_1, or velodyne; of raw data image_00, velodyne_points or oxts",
    _is_kitti,
    _open,
    takes_calibration=True,
)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings in the layout of the TUM RGB-D benchmark."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog


def _recognises(location: LogLocation) -> bool:
    folder = location.folder
    return folder is not None and any((folder / name).is_file() for name in ("rgb.txt", "depth.txt"))


def _open(location: LogLocation, calibration: Path | None) -> IndexedLog:
    from cdff_dev.logs.formats.tum.recording import recording_log

    assert location.folder is not None
    return recording_log(location.folder, calibration)


FORMAT = LogFormat(
    "TUM RGB-D recording", "a folder with rgb.txt and depth.txt", _recognises, _open, takes_calibration=True
)

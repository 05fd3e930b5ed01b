# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Recordings in the layout of the EuRoC MAV data set, and folders of stereo pairs named by their time."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.indexed import IndexedLog

#: Left and right image of a pair: nanoseconds since 1970, then the number of the camera.
PAIR_NAME = re.compile(r"(\d{19})_([01])\.(?:jpg|png)$")


def recording_folder(folder: Path) -> Path | None:
    """Return the folder that contains ``cam0/data.csv`` or ``imu0/data.csv``: the folder or its ``mav0``."""
    for candidate in (folder / "mav0", folder):
        if any((candidate / sensor / "data.csv").is_file() for sensor in ("cam0", "imu0")):
            return candidate
    return None


def folders_of_pairs(folder: Path) -> list[Path]:
    """Return the folder if it contains pairs named by their time, otherwise its sub-folders that do."""
    candidates = [folder, *sorted(path for path in folder.iterdir() if path.is_dir())]
    pair_folders = [path for path in candidates if any(PAIR_NAME.match(file.name) for file in path.iterdir())]
    return pair_folders[:1] if folder in pair_folders else pair_folders


def _recognises(location: LogLocation) -> bool:
    folder = location.folder
    return folder is not None and (recording_folder(folder) is not None or bool(folders_of_pairs(folder)))


def _open(location: LogLocation, calibration: Path | None) -> IndexedLog:
    """Open a recording, or else folders of image pairs."""
    assert location.folder is not None
    if recording := recording_folder(location.folder):
        from cdff_dev.logs.formats.euroc.recording import recording_log

        return recording_log(recording, calibration, location.folder)
    from cdff_dev.logs.formats.euroc.pairs import pairs_log

    return pairs_log(folders_of_pairs(location.folder), calibration, location.folder)


FORMAT = LogFormat(
    "EuRoC recording",
    "a folder with mav0/cam0, or with pairs TIME_0.png and TIME_1.png",
    _recognises,
    _open,
    takes_calibration=True,
)

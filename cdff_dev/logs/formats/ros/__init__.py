# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags of ROS 1 and ROS 2, and MCAP files with messages of ROS or of Foxglove's schemas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_common.contract.foreign_names import robot_name
from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.formats.ros.recording import Recording
    from cdff_dev.logs.source import LogSource

#: First bytes of a ROS 1 bag of any version, of an MCAP file, and of the SQLite database of a ROS 2 bag.
_MAGIC = (b"#ROSBAG V", b"\x89MCAP0\r\n", b"SQLite format 3\0")
#: Files of which a folder has one if it is a recording; a recorder that was ended has written no metadata.
_FOLDER_PATTERNS = ("metadata.yaml", "*.bag", "*.db3", "*.mcap", "*.db3.zstd", "*.mcap.zstd")


def _is_ros(location: LogLocation) -> bool:
    if location.folder is not None:
        return any(any(location.folder.glob(pattern)) for pattern in _FOLDER_PATTERNS)
    return location.head(16).startswith(_MAGIC)


def _open(location: LogLocation, calibration: Path | None) -> LogSource:
    from cdff_dev.logs.formats.ros.bags import open_files, open_folder
    from cdff_dev.logs.formats.ros.original_names import open_recording

    recordings = open_files(location.files) if location.folder is None else open_folder(location.folder)
    if len(recordings) == 1:
        recording = next(iter(recordings.values()))
        return open_recording(recording, robot_name(Path(recording.name)), calibration)
    return _joined(recordings, calibration)


def _joined(recordings: dict[str, Recording], calibration: Path | None) -> LogSource:
    """Return several recordings as one log: each has the robot id that it has if it is opened alone."""
    from cdff_dev.logs.formats.ros.original_names import open_recording
    from cdff_dev.logs.joined import JoinedLog

    logs: dict[str, LogSource] = {}
    try:
        for name, recording in recordings.items():
            logs[Path(name).name] = open_recording(recording, robot_name(Path(name)), calibration)
        return JoinedLog(logs)
    except BaseException:
        for log in logs.values():
            log.close()
        raise


FORMAT = LogFormat(
    "ROS bag or MCAP file",
    ".bag, .mcap or .db3 files, or the folder of a ROS 2 bag",
    _is_ros,
    _open,
    takes_calibration=True,
)

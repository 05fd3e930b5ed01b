# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags of ROS 1 and ROS 2, and MCAP files with messages of ROS or of Foxglove's schemas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_common.errors import InputError
from cdff_dev.logs.formats import LogFormat, LogLocation
from cdff_dev.logs.names import robot_name

if TYPE_CHECKING:
    from cdff_dev.logs.source import LogSource

#: First bytes of a ROS 1 bag, of an MCAP file, and of the SQLite database of a ROS 2 bag.
_MCAP = b"\x89MCAP0\r\n"
_MAGIC = (b"#ROSBAG V2.0\n", _MCAP, b"SQLite format 3\0")


def _is_ros(location: LogLocation) -> bool:
    if location.folder is not None:
        return (location.folder / "metadata.yaml").is_file() or any(location.folder.glob("*.bag"))
    return location.head(16).startswith(_MAGIC)


def _open(location: LogLocation, _: Path | None) -> LogSource:
    from cdff_dev.logs.formats.ros.bags import BagRecording
    from cdff_dev.logs.formats.ros.original_names import open_recording

    folder, files = location.folder, list(location.files)
    if folder is not None:
        files = [folder] if (folder / "metadata.yaml").is_file() else sorted(folder.glob("*.bag"))
    elif location.head(len(_MCAP)) == _MCAP:
        from cdff_dev.logs.formats.ros.mcap_file import McapRecording

        if len(files) > 1:
            raise InputError(f"{location.name}: {len(files)} MCAP files; expected one")
        return open_recording(McapRecording(files[0]), robot_name(files[0]))
    return open_recording(BagRecording(files), robot_name(files[0]))


FORMAT = LogFormat(
    "ROS bag or MCAP file", ".bag, .mcap or .db3 files, or the folder of a ROS 2 bag", _is_ros, _open
)

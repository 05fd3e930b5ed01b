# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Bags of ROS 1 and ROS 2, and MCAP files with ROS 2 messages."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from cdff_dev.logs.formats import LogFormat, LogLocation

if TYPE_CHECKING:
    from cdff_dev.logs.formats.ros.log import RosLog

#: First bytes of a ROS 1 bag, of an MCAP file, and of the SQLite database of a ROS 2 bag.
_MAGIC = (b"#ROSBAG V2.0\n", b"\x89MCAP0\r\n", b"SQLite format 3\0")


def _is_ros(location: LogLocation) -> bool:
    if location.folder is not None:
        return (location.folder / "metadata.yaml").is_file() or any(location.folder.glob("*.bag"))
    return location.head(16).startswith(_MAGIC)


def _open(location: LogLocation, _: Path | None) -> RosLog:
    from cdff_dev.logs.formats.ros.log import RosLog

    folder, files = location.folder, list(location.files)
    if folder is not None:
        files = [folder] if (folder / "metadata.yaml").is_file() else sorted(folder.glob("*.bag"))
    return RosLog(files)


FORMAT = LogFormat("ROS bag", ".bag, .mcap or .db3 files, or the folder of a ROS 2 bag", _is_ros, _open)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of robots, streams and frames from names of files, topics and frames of other frameworks."""

from __future__ import annotations

import re
from pathlib import Path

_MAX_LENGTH = 64
#: Last part of the streams of positions of satellite navigation, and of those that state the location of
#: their local frame: of samples of one time, the location comes first.
FIX_PORT, ANCHOR_PORT = "fix", "anchor"
#: Last part of the streams with the pose of a sensor on the robot.
MOUNT_PORT = "mount"


def robot_name(path: Path) -> str:
    """Return the robot id of a recording: the letters, digits and underscores of its file name."""
    return name_of(path.stem, "robot")


def stream_name(robot: str, topic: str, port: str) -> str:
    """Return the stream of a topic: ``/imu/data`` of ``husky`` is ``/husky/imu_data.imu``."""
    return f"/{robot}/{name_of(topic, 'sensor')}.{port}"


def frame_name(robot: str, frame_id: str) -> str:
    """Return the frame of a ``frame_id``: ``base_link`` of ``husky`` is ``husky/base_link``."""
    return f"{robot}/{name_of(frame_id, 'unnamed')}"


def name_of(text: str, default: str) -> str:
    """Return a text as a name of a profile: lower case, and underscores for everything else."""
    name = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:_MAX_LENGTH]
    return name if name[:1].isalpha() else f"{default}_{name}"[:_MAX_LENGTH].rstrip("_")


def is_fix(stream: str) -> bool:
    """Return whether a stream holds positions of satellite navigation."""
    return stream.endswith(f".{FIX_PORT}")


def is_mount(stream: str) -> bool:
    """Return whether a stream states the pose of a sensor on the robot."""
    return stream.endswith(f".{MOUNT_PORT}")


def is_anchor(stream: str) -> bool:
    """Return whether a stream states the location of a local frame on the Earth."""
    return stream.endswith(f".{ANCHOR_PORT}")

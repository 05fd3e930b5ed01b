# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Names of streams and frames in a converted log, as a YAML file.

    streams:
      /kitti/lidar.scan: {to: /lidar}
      /kitti/truth.pose: {to: /truth/pose, message: geometry_msgs/msg/PoseStamped}
    frames:
      kitti/lidar: velodyne
    anchors:
      site: {lon_deg: 1.48, lat_deg: 43.56, height_m: 150.0, azimuth_deg: 0.0}

``anchors`` are the locations of frames on the Earth, for positions as ``sensor_msgs/msg/NavSatFix``. ``to``
is a topic, or a stream if the new log is InFuse. Streams and frames that are not listed have the names of
``default_topics``.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from cdff_common.contract.foreign_names import is_anchor, is_mount
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, body
from cdff_dev.logs.source import StreamInfo

_KEYS = {"streams", "frames", "anchors"}
_STREAM_KEYS = {"to", "message"}
_ANCHOR_KEYS = {"lon_deg", "lat_deg", "height_m", "azimuth_deg"}
_ROS_NAME = re.compile(r"[^A-Za-z0-9_/]+")
#: Units of the values of a type in logs of CDFF and of ROS; they are equal unless both are named.
_UNITS = {
    "DistanceImage": "m; in ROS 16 bits in mm if that is exact, else 32FC1 in m",
    "Frame": "pixels",
    "FramePair": "pixels, baseline in m",
    "IMUSensors": "m/s², rad/s",
    "Joints": "rad or m, rad/s or m/s, N m or N",
    "LidarScan": "m; times in µs after the start, in ROS in ns after the stamp",
    "TransformWithCovariance": "m, covariance in m² and rad²",
}


@dataclass(frozen=True, slots=True)
class StreamTarget:
    """Name of a stream in the new log, and the type of its messages there, if not the default."""

    to: str
    message: str = ""


@dataclass(frozen=True, slots=True)
class LogMap:
    """Names in a new log.

    Attributes
    ----------
    streams : mapping
        Targets by stream.
    frames : mapping
        Names in the new log by the frame in CDFF.
    anchors : mapping
        Locations of frames on the Earth.
    """

    streams: Mapping[str, StreamTarget] = field(default_factory=dict)
    frames: Mapping[str, str] = field(default_factory=dict)
    anchors: Mapping[str, Anchor] = field(default_factory=dict)

    def frame(self, frame: str) -> str:
        """Return the name of a frame in the new log: without the robot, unless the map names it."""
        return self.frames.get(frame, frame.rpartition("/")[2] if frame.count("/") == 1 else frame)


def topic_map(streams: Mapping[str, StreamInfo], chosen: LogMap | None = None) -> LogMap:
    """Return the map of all streams to topics: the targets of ``chosen``, else the default ones.

    Raises
    ------
    InputError
        If ``chosen`` names a stream that is not in the log, or two streams have one topic.
    """
    chosen = chosen or LogMap()
    _check_known(chosen, streams)
    targets = {name: StreamTarget(topic) for name, topic in default_topics(streams).items()}
    for name, target in chosen.streams.items():
        targets[name] = StreamTarget("/" + ros_name(target.to), target.message)
    streams_per_topic = Counter(target.to for target in targets.values())
    if double := [topic for topic, count in streams_per_topic.items() if count > 1]:
        raise InputError(f"topic {double[0]} of several streams: name another with --map")
    return LogMap(targets, chosen.frames, chosen.anchors)


def stream_map(streams: Mapping[str, StreamInfo], chosen: LogMap | None = None) -> LogMap:
    """Return the map of all streams to streams of a log of CDFF; raises InputError as ``topic_map``."""
    chosen = chosen or LogMap()
    _check_known(chosen, streams)
    targets = {name: chosen.streams.get(name, StreamTarget(name)) for name in streams}
    return LogMap(targets, chosen.frames, chosen.anchors)


def default_topics(streams: Mapping[str, StreamInfo]) -> dict[str, str]:
    """Return a topic for each stream.

    ``/kitti/lidar.scan`` is on ``/lidar``, or on ``/kitti/lidar`` if the log has several robots, followed by
    the port if the sensor has several streams other than the place of its frame. The topics of true values
    begin with ``/truth``.
    """
    parts = {name: _parts(name) for name in streams}
    robots = {robot for robot, _, _ in parts.values()}
    places = {name for name in streams if is_anchor(name) or is_mount(name)}
    sensors = Counter((robot, sensor) for name, (robot, sensor, _) in parts.items() if name not in places)
    topics = {}
    for name, (robot, sensor, port) in parts.items():
        words = [sensor] if len(robots) == 1 else [robot, sensor]
        if sensor == "truth":
            words = ["truth", *words[:-1], port]
        elif sensors[robot, sensor] > 1 or name in places:
            words.append(port)
        topics[name] = "/" + ros_name("/".join(words))
    return topics


def ros_name(text: str) -> str:
    """Return a text as the name of a topic: letters, digits and underscores between slashes."""
    return _ROS_NAME.sub("_", text).strip("/")


def _parts(stream: str) -> tuple[str, str, str]:
    """Return robot, sensor and port of a stream."""
    robot, _, sensor_and_port = stream.strip("/").rpartition("/")
    sensor, _, port = sensor_and_port.partition(".")
    return robot or sensor, sensor, port or "value"


def _check_known(chosen: LogMap, streams: Mapping[str, StreamInfo]) -> None:
    if unknown := [name for name in chosen.streams if name not in streams]:
        raise InputError(f"--map: stream {unknown[0]} is not in the log; expected {', '.join(streams)}")


def read_map(path: Path) -> LogMap:
    """Read a map; raises InputError with the file and the key that is not as expected."""
    try:
        content = yaml.safe_load(path.read_text(encoding="utf-8")) or {}
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise InputError(f"--map {path}: {error}") from error
    if not isinstance(content, dict) or not content.keys() <= _KEYS:
        raise InputError(f"--map {path}: expected a mapping with streams, frames and anchors")
    streams, frames, anchors = (_mapping(path, content, key) for key in ("streams", "frames", "anchors"))
    targets = {str(name): _target(path, str(name), entry) for name, entry in streams.items()}
    return LogMap(
        targets,
        {str(frame): str(name) for frame, name in frames.items()},
        {str(frame): _anchor(path, str(frame), entry) for frame, entry in anchors.items()},
    )


def _mapping(path: Path, content: dict[str, Any], key: str) -> dict[Any, Any]:
    value = content.get(key) or {}
    if not isinstance(value, dict):
        raise InputError(f"--map {path}: {key}: {value!r}, expected a mapping")
    return value


def _anchor(path: Path, frame: str, entry: Any) -> Anchor:
    """Return the anchor of a frame on the Earth from an entry of a map file; raises InputError."""
    expected = "lon_deg and lat_deg, and optionally height_m and azimuth_deg"
    if not isinstance(entry, dict) or not {"lon_deg", "lat_deg"} <= entry.keys() <= _ANCHOR_KEYS:
        raise InputError(f"--map {path}: anchor of {frame}: {entry!r}, expected {expected}")
    try:
        numbers = {str(key): float(value) for key, value in entry.items()}
    except (TypeError, ValueError) as error:
        raise InputError(f"--map {path}: anchor of {frame}: {error}; expected numbers: {expected}") from error
    return Anchor(body("earth"), **numbers)


def _target(path: Path, name: str, entry: Any) -> StreamTarget:
    if not isinstance(entry, dict) or not entry.keys() <= _STREAM_KEYS or not entry.get("to"):
        raise InputError(f"--map {path}: {name}: {entry!r}, expected to, and optionally message")
    return StreamTarget(str(entry["to"]), str(entry.get("message", "")))


def map_text(streams: Mapping[str, StreamInfo], mapping: LogMap) -> str:
    """Return a map as YAML, with type and units of each stream as comments."""
    lines = ["streams:"]
    for name, target in mapping.streams.items():
        type_name = streams[name].type_name
        unit = f": {_UNITS[type_name]}" if type_name in _UNITS else ""
        entry = (
            f"{{to: {target.to}, message: {target.message}}}" if target.message else f"{{to: {target.to}}}"
        )
        lines.append(f"  {name}: {entry}  # {type_name}{unit}")
    lines.append("frames: {}  # frame of CDFF: name in the new log; by default without the robot")
    return "\n".join(lines)

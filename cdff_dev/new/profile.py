# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission profile for the robot of a log: its sensors, their rates, and the DFPCs that they permit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from cdff_common.errors import InputError
from cdff_dev.logs.source import LogSource, split_stream

#: Kind of the sensor of a stream, by its ASN.1 type.
_KINDS = {
    "FramePair": "stereo_camera",
    "Frame": "camera",
    "LidarScan": "lidar",
    "IMUSensors": "imu",
    "TransformWithCovariance": "wheels",
}
#: Rotation of a level camera that looks ahead: x right, y down, z forward.
_CAMERA_AXES = ", quaternion_xyzw: [-0.5, 0.5, -0.5, 0.5]"
_HEADER = """\
# Written by `cdff new profile` from {log}. A log does not contain the mounts of the sensors (frames),
# the limits of the rover and the noise of the sensors (parameters): enter these.
# Fields: docs/reference/profile.md
"""


@dataclass(frozen=True, slots=True)
class _Sensor:
    """Sensor of a log: ``streams`` has the type of each stream, ``rate_hz`` is that of the first."""

    name: str
    kind: str
    frame: str
    streams: Mapping[str, str]
    rate_hz: float

    @property
    def source(self) -> str:
        """Source of a port that takes its first stream."""
        return f"sensor/{self.name}/{next(iter(self.streams))}"


def profile_text(log: LogSource, path: str, name: str) -> str:
    """Return a profile as YAML.

    Parameters
    ----------
    path : str
        The log, for the comment.
    name : str
        Name of the profile.

    Raises
    ------
    InputError
        If the log has no stream of a sensor.
    """
    robots = _robots(log)
    if not robots:
        streams = ", ".join(log.streams) or "no streams"
        raise InputError(f"{path}: expected a stream /robot/sensor.stream with samples; it has {streams}")
    lines = [*_HEADER.format(log=path).splitlines(), f"name: {name}", f"doc: Robots of {Path(path).name}."]
    lines += ["# Body of the mission, e.g. moon, mars, earth.", "body: {name: mars}", "robots:"]
    for robot, sensors in robots.items():
        lines += _robot_lines(robot, sensors)
    return "\n".join(lines) + "\n"


def _robots(log: LogSource) -> dict[str, list[_Sensor]]:
    """Return the sensors of each robot, without true poses."""
    streams: dict[tuple[str, str], dict[str, str]] = {}
    for stream, info in log.streams.items():
        try:
            robot, sensor, item = split_stream(stream)
        except InputError:  # a stream of no robot
            continue
        if sensor != "truth" and not info.is_empty:
            streams.setdefault((robot, sensor), {})[stream] = item
    robots: dict[str, list[_Sensor]] = {}
    for (robot, sensor), items in streams.items():
        first = next(iter(items))
        info = log.streams[first]
        duration_s = (info.t1_ns - info.t0_ns) * 1e-9
        rate_hz = (info.count - 1) / duration_s if duration_s > 0 else 0.0
        types = {item: log.streams[stream].type_name for stream, item in items.items()}
        kind = _KINDS.get(info.type_name, "other")
        frame = f"{robot}/base" if kind == "wheels" else _frame(log, first)
        robots.setdefault(robot, []).append(_Sensor(sensor, kind, frame, types, rate_hz))
    return robots


def _frame(log: LogSource, stream: str) -> str:
    """Return the frame of a sensor: that of its first sample."""
    sample = next(iter(log.samples([stream])))
    robot, sensor, _ = split_stream(stream)
    return sample.to_sample("", robot).frame or f"{robot}/{sensor}"


def _robot_lines(robot: str, sensors: list[_Sensor]) -> Iterator[str]:
    yield f"  - id: {robot}"
    yield "    # Enter the limits of the rover."
    yield (
        "    limits: {max_slope_deg: 15.0, max_step_m: 0.15, max_roughness_m: 0.08, "
        "width_m: 1.0, length_m: 1.2, height_m: 1.2}"
    )
    yield "    frames:"
    yield f"      - {{parent: site, child: {robot}/odom}}"
    yield "      # Enter the mounts: position in the base (x forward, y left, z up) and rotation."
    for frame, kind in {s.frame: s.kind for s in sensors if s.frame != f"{robot}/base"}.items():
        rotation = _CAMERA_AXES if "camera" in kind else ""
        yield f"      - {{parent: {robot}/base, child: {frame}, translation_m: [0.0, 0.0, 0.0]{rotation}}}"
    yield "    sensors:"
    for sensor in sensors:
        streams = ", ".join(f"{item}: {type_name}" for item, type_name in sensor.streams.items())
        yield f"      {sensor.name}:"
        yield f"        kind: {sensor.kind}"
        yield f"        frame: {sensor.frame}"
        yield f"        streams: {{{streams}}}"
        if sensor.rate_hz > 0:
            yield f'        modes: {{"off": {{on: false}}, nominal: {{rate_hz: {sensor.rate_hz:.3g}}}}}'
            yield "        initial_mode: nominal"
    entries = list(_dfpc_lines({s.kind: s for s in reversed(sensors)}))
    yield from ["    dfpcs:", *entries] if entries else ["    dfpcs: []"]


def _dfpc_lines(by_kind: Mapping[str, _Sensor]) -> Iterator[str]:
    """Yield the entries of localisation and mapping that the sensors permit."""
    lidar, stereo = by_kind.get("lidar"), by_kind.get("stereo_camera")
    wheels, imu = by_kind.get("wheels"), by_kind.get("imu")
    motion = {"odometry": wheels, "imu": imu}
    guides = {port: sensor.source for port, sensor in motion.items() if sensor is not None}
    sources = dict(guides)
    if lidar is not None:
        guide = {"odometry": guides["odometry"]} if "odometry" in guides else {}
        yield from _entry("lidar_slam", "slam", {"scan": lidar.source} | guide, lidar)
        sources["visual_odometry"] = "product/lidar_slam/odometry"
    elif stereo is not None:
        yield from _entry("visual_odometry_sparse", "vision", {"stereo": stereo.source} | guides, stereo)
        sources["visual_odometry"] = "product/visual_odometry_sparse/pose"
    if sources:
        yield from _entry("position_manager", "position", sources, None)
    ranging = lidar or stereo
    if ranging is not None:
        port = "scan" if ranging is lidar else "stereo"
        inputs = {port: ranging.source, "poses": "product/position_manager/pose"}
        variant = "Lidar" if ranging is lidar else "Stereo"
        yield from _entry("digital_elevation_mapping", "mapping", inputs, ranging, variant, is_always=False)
        dem = {"dem": "product/digital_elevation_mapping/map"}
        yield from _entry("navigation_mapping", "mapping", dem, None, is_always=False)


def _entry(
    name: str,
    process: str,
    inputs: Mapping[str, str],
    sensor: _Sensor | None,
    implementation: str = "",
    *,
    is_always: bool = True,
) -> Iterator[str]:
    yield f"      - name: {name}"
    yield f"        process: {process}"
    if implementation:
        yield f"        implementation: {implementation}"
    if is_always:
        yield "        activation: always"
    yield f"        inputs: {{{', '.join(f'{port}: {source}' for port, source in inputs.items())}}}"
    if sensor is not None and sensor.rate_hz > 0:
        yield f"        modes: {{{sensor.name}: nominal}}"

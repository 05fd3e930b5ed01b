# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A mission profile for the sensors of a robot: mounts, rates, and the DFPCs that they permit."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from cdff_common.contract.foreign_names import is_anchor, is_fix, is_mount
from cdff_common.errors import InputError
from cdff_common.geometry import FrameGraph, se3
from cdff_common.geometry.se3 import FloatArray
from cdff_dev.logs.mounts import mounts
from cdff_dev.logs.source import LogSource, split_stream
from cdff_dev.logs.timing import timing
from cdff_dev.new.mounts import CameraMounts, edge_line

#: Kind of the sensor of a stream, by its ASN.1 type.
KINDS = {
    "FramePair": "stereo_camera",
    "Frame": "camera",
    "LidarScan": "lidar",
    "IMUSensors": "imu",
    "TransformWithCovariance": "wheels",
}
#: Rotation of a level camera that looks ahead: x right, y down, z forward.
CAMERA_AXES = se3.transform(se3.matrix_from_quaternion_xyzw([-0.5, 0.5, -0.5, 0.5]), np.zeros(3))
_HEADER = """\
# Written by `{command}` from {source}.
# Enter the values that it does not contain: the mounts of the sensors (frames), the limits of the rover,
# and the noise of the sensors (parameters). Mounts from a drive:
# cdff calibrate extrinsics LOG --profile FILE --write
# Fields: docs/reference/profile.md. Frames: docs/explanation/frames.md.
"""
_STATED = "  # of the recording"
_DEFAULT_LIMITS = {
    "max_slope_deg": 15.0,
    "max_step_m": 0.15,
    "max_roughness_m": 0.08,
    "width_m": 1.0,
    "length_m": 1.2,
    "height_m": 1.2,
}


@dataclass(frozen=True, slots=True, eq=False)
class SensorDraft:
    """Sensor of a robot.

    Attributes
    ----------
    name, kind, frame : str
    streams : mapping of str to str
        Type of each stream.
    rate_hz : float
        Rate of the first stream; 0 if it is not known.
    mount : array, shape (4, 4), or None
        Pose in the base, or in ``mount_parent``; None: to be entered.
    mount_parent : str
        Frame of the mount: that of another sensor, or the base as the log names it; empty for the base.
    child : str
        Frame whose poses a wheel sensor measures; empty for the base.
    local_frame : str
        Frame in which satellite navigation measures positions; empty for other sensors.
    """

    name: str
    kind: str
    frame: str
    streams: Mapping[str, str]
    rate_hz: float
    mount: FloatArray | None = None
    mount_parent: str = ""
    child: str = ""
    local_frame: str = ""

    @property
    def source(self) -> str:
        """Source of a port that takes its first stream."""
        return f"sensor/{self.name}/{next(iter(self.streams))}"


@dataclass(frozen=True, slots=True, eq=False)
class RobotDraft:
    """Robot of a new profile.

    Attributes
    ----------
    id : str
    sensors : sequence of SensorDraft
    limits : mapping of str to float
    urdf : str
        File of the URDF, relative to the profile; empty without one.
    urdf_frames : collection of str
        Frames of its links.
    cameras : CameraMounts or None
        Poses of its cameras.
    """

    id: str
    sensors: Sequence[SensorDraft]
    limits: Mapping[str, float] = field(default_factory=lambda: dict(_DEFAULT_LIMITS))
    urdf: str = ""
    urdf_frames: Collection[str] = ()
    cameras: CameraMounts | None = None


def profile_text(
    robots: Sequence[RobotDraft],
    source: str,
    name: str,
    body: str = "mars",
    command: str = "cdff new profile",
) -> str:
    """Return a profile as YAML.

    Parameters
    ----------
    source : str
        Origin of the drafts, for the comment.
    name, body : str
        Name of the profile, and body of the mission.
    command : str
        Command that writes it, for the comment.
    """
    lines = [*_HEADER.format(source=source, command=command).splitlines(), f"name: {name}"]
    lines += [f"doc: Robots of {Path(source).name}."]
    lines += ["# Body of the mission, e.g. moon, mars, earth.", f"body: {{name: {body}}}", "robots:"]
    for robot in robots:
        lines += _robot_lines(robot)
    return "\n".join(lines) + "\n"


def robots_of_log(log: LogSource, path: str) -> list[RobotDraft]:
    """Return the robots of a log with their sensors.

    Raises
    ------
    InputError
        If the log has no stream of a sensor.
    """
    robots = _robots(log)
    if not robots:
        streams = ", ".join(log.streams) or "no streams"
        raise InputError(f"{path}: expected a stream /robot/sensor.stream with samples; it has {streams}")
    graph = mounts(log)
    return [RobotDraft(robot, _with_mounts(robot, sensors, graph)) for robot, sensors in robots.items()]


def _with_mounts(robot: str, sensors: Sequence[SensorDraft], graph: FrameGraph) -> list[SensorDraft]:
    """Return sensors with the mounts that the log states, in the base or the frame of another sensor."""
    parents = {f"{robot}/base", *(s.child for s in sensors), *(s.frame for s in sensors)}
    drafts = []
    for sensor in sensors:
        root = sensor.frame
        while (parent := graph.parent_of(root)) is not None:
            root = parent
        if root != sensor.frame and root in parents and sensor.frame != f"{robot}/base":
            T = np.asarray(graph.lookup(root, sensor.frame, 0).matrix, np.float64)
            drafts.append(replace(sensor, mount=T, mount_parent="" if root == f"{robot}/base" else root))
        else:
            drafts.append(sensor)
    return drafts


def _robots(log: LogSource) -> dict[str, list[SensorDraft]]:
    """Return the sensors of each robot, without true poses and locations of frames."""
    streams: dict[tuple[str, str], dict[str, str]] = {}
    for stream, info in log.streams.items():
        try:
            robot, sensor, item = split_stream(stream)
        except InputError:  # a stream of no robot
            continue
        if sensor != "truth" and not (info.is_empty or is_anchor(stream) or is_mount(stream)):
            streams.setdefault((robot, sensor), {})[stream] = item
    robots: dict[str, list[SensorDraft]] = {}
    for (robot, sensor), items in streams.items():
        first = next(iter(items))
        info = log.streams[first]
        times = timing(log.stamps_ns(first))
        rate_hz = times.mean_rate_hz if times.has_bursts else times.rate_hz
        types = {item: log.streams[stream].type_name for stream, item in items.items()}
        kind = "other" if is_fix(first) else KINDS.get(info.type_name, "other")
        if is_fix(first):
            frame = _child(log, first) or f"{robot}/base"
            draft = SensorDraft(sensor, kind, frame, types, rate_hz, local_frame=_frame(log, first))
        elif kind == "wheels":
            draft = SensorDraft(sensor, kind, f"{robot}/base", types, rate_hz, child=_child(log, first))
        else:
            draft = SensorDraft(sensor, kind, _frame(log, first), types, rate_hz)
        robots.setdefault(robot, []).append(draft)
    return robots


def _frame(log: LogSource, stream: str) -> str:
    """Return the frame of a sensor: that of its first sample."""
    sample = next(iter(log.samples([stream])))
    robot, sensor, _ = split_stream(stream)
    return sample.to_sample("", robot).frame or f"{robot}/{sensor}"


def _child(log: LogSource, stream: str) -> str:
    """Return the frame whose poses a stream contains; empty for the base of the robot."""
    sample = next(iter(log.samples([stream])))
    robot, _, _ = split_stream(stream)
    child = sample.to_sample("", robot).child
    return "" if child == f"{robot}/base" else child


def _robot_lines(robot: RobotDraft) -> Iterator[str]:
    """Yield the lines of a robot in the profile."""
    yield f"  - id: {robot.id}"
    yield "    # Enter the limits of the rover."
    yield f"    limits: {{{', '.join(f'{name}: {value:g}' for name, value in robot.limits.items())}}}"
    if robot.urdf:
        yield "    # Its links are frames: the root is the base, and each other link NAME is ROBOT/NAME."
        yield f"    urdf: {robot.urdf}"
    yield "    frames:"
    yield "      # The start: enter its position and heading if the site is known."
    yield f"      - {{parent: site, child: {robot.id}/odom}}"
    for frame in sorted({s.local_frame for s in robot.sensors if s.local_frame}):
        yield f"      - {{parent: site, child: {frame}}}  # east, north, up at the first position"
    edges = list(_edges(robot))
    if any(T is None for _, _, T, _ in edges):
        yield "      # Enter the mounts: position in the base (x forward, y left, z up) and rotation."
    for parent, child, T, comment in edges:
        is_camera = any(s.frame == child and "camera" in s.kind for s in robot.sensors)
        T_written = CAMERA_AXES if T is None and is_camera else T
        yield f"      - {edge_line(parent, child, T_written, comment)}"
    sensors = robot.sensors
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


def _edges(robot: RobotDraft) -> Iterator[tuple[str, str, FloatArray | None, str]]:
    """Yield parent, child, transform (None: to be entered) and comment of each edge that the URDF lacks."""
    base, sensor_by_frame = f"{robot.id}/base", {s.frame: s for s in robot.sensors}
    imu = next((s.frame for s in robot.sensors if s.kind == "imu"), None)
    camera = next((s for s in robot.sensors if "camera" in s.kind), None)
    poses = list(robot.cameras.poses.values()) if robot.cameras is not None and camera is not None else []
    comment = f"  # {robot.cameras.source}" if robot.cameras is not None else ""
    for frame, sensor in sensor_by_frame.items():
        if frame == base or frame in robot.urdf_frames:
            continue
        if (
            sensor is camera
            and poses
            and robot.cameras is not None
            and robot.cameras.by_imu
            and imu is not None
        ):
            yield imu, frame, poses[0], comment
        else:
            yield sensor.mount_parent or base, frame, sensor.mount, "" if sensor.mount is None else _STATED
    for child in {
        s.child: None
        for s in robot.sensors
        if s.child and s.child not in {*sensor_by_frame, *robot.urdf_frames}
    }:
        yield base, child, np.eye(4), "  # the base as the wheels name it"
    if camera is not None and camera.kind == "stereo_camera" and len(poses) > 1:
        right = camera.frame.replace("left", "right") if "left" in camera.frame else f"{camera.frame}_right"
        if right not in robot.urdf_frames:
            yield camera.frame, right, se3.inverse(poses[0]) @ poses[1], comment


def _dfpc_lines(by_kind: Mapping[str, SensorDraft]) -> Iterator[str]:
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
    sensor: SensorDraft | None,
    implementation: str = "",
    *,
    is_always: bool = True,
) -> Iterator[str]:
    """Yield the lines of a DFPC in the profile."""
    yield f"      - name: {name}"
    yield f"        process: {process}"
    if implementation:
        yield f"        implementation: {implementation}"
    if is_always:
        yield "        activation: always"
    yield f"        inputs: {{{', '.join(f'{port}: {source}' for port, source in inputs.items())}}}"
    if sensor is not None and sensor.rate_hz > 0:
        yield f"        modes: {{{sensor.name}: nominal}}"

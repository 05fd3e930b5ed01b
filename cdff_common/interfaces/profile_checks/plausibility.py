# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values of a profile that are possible but improbable: distances in millimetres, swapped axes."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from cdff_common.errors import CdffError
from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.geometry.se3 import FloatArray
from cdff_common.geometry.urdf import read_urdf
from cdff_common.interfaces.profile import Robot
from cdff_common.interfaces.profile_checks.faults import Finding
from cdff_common.interfaces.profile_checks.frames import owner_of
from cdff_common.interfaces.profile_checks.reading import Reading
from cdff_common.interfaces.sensor_profile import Sensor
from cdff_common.interfaces.yaml_file import Location

#: Bounds of the mounts of rovers and servicers: farther from the base than 3 m, a baseline below 1 cm or over
#: 2 m, and an inclination above 60 degrees are rare.
FARTHEST_MOUNT_M, SHORTEST_BASELINE_M, LONGEST_BASELINE_M, GREATEST_TILT_DEG = 3.0, 0.01, 2.0, 60.0


def plausibility_findings(reading: Reading) -> Iterator[Finding]:
    """Yield warnings of the mounts of every robot; its frames have no faults."""
    assert reading.profile is not None
    for i, robot in enumerate(reading.profile.robots):
        edges = {edge.child: k for k, edge in enumerate(robot.frames)}
        for k, edge in enumerate(robot.frames):
            distance_m = float(np.linalg.norm(edge.translation_m))
            place: Location = ("robots", i, "frames", k, "translation_m")
            is_mount = owner_of(edge.parent) == owner_of(edge.child) == robot.id
            if is_mount and edge.child != f"{robot.id}/odom" and distance_m > FARTHEST_MOUNT_M:
                problem = (
                    f"{edge.child} is {distance_m:g} m from {edge.parent}, expected at most "
                    f"{FARTHEST_MOUNT_M:g} m; the unit is metres"
                )
                yield Finding(place, problem, list(edge.translation_m), "", "warning")
        yield from _baseline_findings(robot, i)
        yield from _tilt_findings(robot, i, edges)


def _baseline_findings(robot: Robot, i: int) -> Iterator[Finding]:
    """Yield a finding for each stereo baseline outside the usual range."""
    lefts = {sensor.frame for sensor in robot.sensors.values() if sensor.kind == "stereo_camera"}
    for k, edge in enumerate(robot.frames):
        if edge.parent not in lefts or "right" not in edge.child.rsplit("/", maxsplit=1)[-1]:
            continue
        baseline_m = float(np.linalg.norm(edge.translation_m))
        if not SHORTEST_BASELINE_M <= baseline_m <= LONGEST_BASELINE_M:
            problem = (
                f"baseline of {baseline_m:g} m, expected {SHORTEST_BASELINE_M:g} to "
                f"{LONGEST_BASELINE_M:g} m; the unit is metres"
            )
            place: Location = ("robots", i, "frames", k, "translation_m")
            yield Finding(place, problem, list(edge.translation_m), "", "warning")


def _tilt_findings(robot: Robot, i: int, edges: dict[str, int]) -> Iterator[Finding]:
    """Yield a finding for each sensor whose mount has an unusual orientation."""
    graph = _graph_at_zero(robot)
    for name, sensor in robot.sensors.items():
        try:
            R = graph.lookup(f"{robot.id}/base", sensor.frame, 0).matrix[:3, :3]
        except CdffError:  # reported with the frames
            continue
        problem = _tilt_problem(sensor, R)
        if problem:
            edge = edges.get(sensor.frame)
            place: Location = ("robots", i, "sensors", name, "frame")
            if edge is not None:
                place = ("robots", i, "frames", edge)
            yield Finding(place, f"sensor {name}: {problem}", sensor.frame, "", "warning")


def _tilt_problem(sensor: Sensor, R_base_sensor: FloatArray) -> str:
    """Return the reason why an orientation is improbable, empty if it is not."""
    if sensor.kind in ("lidar", "imu"):
        tilt_deg = float(np.rad2deg(np.arccos(np.clip(R_base_sensor[2, 2], -1.0, 1.0))))
        if tilt_deg > GREATEST_TILT_DEG:
            return (
                f"its z axis is {tilt_deg:.0f}° from the vertical of the base, expected at most "
                f"{GREATEST_TILT_DEG:g}°; quaternions are [x, y, z, w], a positive pitch lowers the x axis"
            )
    if sensor.kind in ("camera", "stereo_camera"):
        elevation_deg = float(np.rad2deg(np.arcsin(np.clip(R_base_sensor[2, 2], -1.0, 1.0))))
        if abs(elevation_deg) > GREATEST_TILT_DEG:
            return (
                f"its optical axis z is {elevation_deg:.0f}° above the horizon, expected at most "
                f"{GREATEST_TILT_DEG:g}°; axes of a camera: x right, y down, z forward"
            )
        if R_base_sensor[2, 1] > np.sin(np.deg2rad(GREATEST_TILT_DEG / 2.0)):
            return "its y axis points up, so that images are upside down; axes: x right, y down, z forward"
    return ""


def _graph_at_zero(robot: Robot) -> FrameGraph:
    """Return the frames of a robot with its joints at 0."""
    graph = robot.frame_graph()
    if robot.urdf:
        model = read_urdf(robot.urdf)
        for joint in (j for j in model.joints if j.movable):
            ends = model.frame(robot.id, joint.parent), model.frame(robot.id, joint.child)
            graph.set_static(*ends, UncertainTransform.exact(joint.transform(0.0)))
    return graph

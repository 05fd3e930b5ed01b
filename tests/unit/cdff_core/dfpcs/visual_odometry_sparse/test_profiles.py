# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shipped profiles connect visual odometry with the wheels and the gyro of their robots."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.interfaces.profile import Robot, load_profile

PROFILES = Path(__file__).parents[5] / "deploy" / "profiles"
#: Input port of each kind of sensor.
PORT_OF = {"wheels": "odometry", "imu": "imu"}
ROBOTS = [
    pytest.param(robot, id=f"{path.stem}-{robot.id}")
    for path in sorted(PROFILES.glob("*.yaml"))
    for robot in load_profile(path).robots
    if any(entry.name == "visual_odometry_sparse" for entry in robot.dfpcs)
]


@pytest.mark.req("CDFF-CORE-070")
@pytest.mark.parametrize("robot", ROBOTS)
def test_wheels_and_gyro_are_connected_to_visual_odometry(robot: Robot) -> None:
    inputs = next(entry.inputs for entry in robot.dfpcs if entry.name == "visual_odometry_sparse")
    connected = {
        PORT_OF[sensor.kind]: f"sensor/{name}/{stream}"
        for name, sensor in robot.sensors.items()
        if sensor.kind in PORT_OF
        for stream in sensor.streams
    }
    assert {port: source for port, source in inputs.items() if port != "stereo"} == connected
    # A sensor without mount is not used, and both need the mount of the camera.
    frames_with_mounts = {edge.child for edge in robot.frames} | {f"{robot.id}/base"}
    assert frames_with_mounts >= {sensor.frame for sensor in robot.sensors.values()}

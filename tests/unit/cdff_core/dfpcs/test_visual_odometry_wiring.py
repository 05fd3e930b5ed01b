# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Shipped profiles give visual odometry the wheels and the gyro that their robots have."""

from __future__ import annotations

from pathlib import Path

import pytest

from cdff_common.interfaces.profile import Robot, load_profile

PROFILES = Path(__file__).parents[4] / "deploy" / "profiles"
#: The port that takes what a kind of sensor feels.
PORT_OF = {"wheels": "odometry", "imu": "imu"}
ROBOTS = [
    pytest.param(robot, id=f"{path.stem}-{robot.id}")
    for path in sorted(PROFILES.glob("*.yaml"))
    for robot in load_profile(path).robots
    if any(entry.name == "visual_odometry_sparse" for entry in robot.dfpcs)
]


@pytest.mark.req("CDFF-CORE-070")
@pytest.mark.parametrize("robot", ROBOTS)
def test_what_a_robot_feels_is_wired_to_its_visual_odometry(robot: Robot) -> None:
    inputs = next(entry.inputs for entry in robot.dfpcs if entry.name == "visual_odometry_sparse")
    felt = {
        PORT_OF[sensor.kind]: f"sensor/{name}/{stream}"
        for name, sensor in robot.sensors.items() if sensor.kind in PORT_OF
        for stream in sensor.streams
    }  # fmt: skip
    assert {port: source for port, source in inputs.items() if port != "stereo"} == felt
    # Without its mount a sensor says nothing (the camera's, for both).
    mounted = {edge.child for edge in robot.frames} | {f"{robot.id}/base"}
    assert mounted >= {sensor.frame for sensor in robot.sensors.values()}

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 2 between a bus and a robot of which only one has certificates."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import zenoh

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.identity import Identity
from cdff_common.clock import wall_ns
from cdff_dev.ports import free_port
from tests.integration.conftest import Spawn, process_starter, wait_until
from tests.integration.test_gateway_ros2 import Robot
from tests.support.identities import make_identities, open_as
from tests.support.secured_mission import secured_mission

pytestmark = [pytest.mark.integration, pytest.mark.slow]

_SETTINGS = """robot: mana
frames: {imu_link: mana/imu}
inputs: [{topic: /imu/data, type: sensor_msgs/msg/Imu, stream: imu/sample, frame: mana/imu}]
"""


def test_the_identity_of_the_robot_is_for_the_bus_and_not_for_its_own_network(tmp_path: Path) -> None:
    robot_endpoint, settings = f"tcp/127.0.0.1:{free_port()}", tmp_path / "gateway.yaml"
    settings.write_text(_SETTINGS)
    folders = [tmp_path / name for name in ("mission", "robot", "gateway")]
    for folder in folders:
        folder.mkdir()
    with secured_mission(folders[0]) as mission, process_starter(robot_endpoint, folders[1]) as start_robot:
        start_robot("services.router")
        identity = str(mission.keys.folder / "mana")
        with process_starter(mission.endpoint, folders[2], CDFF_IDENTITY=identity) as start:
            options = ("--settings", str(settings), "--connect", mission.endpoint)
            start("services.gateway_ros2", *options, "--ros-connect", robot_endpoint)
            samples: list[Message] = []
            mission.bus("ground").subscribe(keys.sensor("mana", "imu", "sample"), samples.append)
            with Bus.open(robot_endpoint, name="robot", wait_s=30.0) as bus:
                robot = Robot(bus)

                def is_received() -> bool:
                    robot.publish("/imu/data", "sensor_msgs/msg/Imu", robot.imu(wall_ns()))
                    return bool(samples)

                wait_until(is_received, 60.0, "a sample on the secured bus")


def test_a_robot_whose_router_needs_certificates_is_reached_with_their_folder(
    router: object, endpoint: str, spawn: Spawn, tmp_path: Path
) -> None:
    robot_keys, settings = make_identities(tmp_path / "robot"), tmp_path / "gateway.yaml"
    settings.write_text(_SETTINGS)
    robot_endpoint = f"tls/127.0.0.1:{free_port()}"
    config = zenoh.Config()
    tls = Identity.read(robot_keys.folder / "ground").settings(listens=True)
    for key, value in {"mode": "router", "listen/endpoints": [robot_endpoint], **tls}.items():
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config), Bus.open(endpoint, name="test", wait_s=30.0) as bus:
        identity = str(robot_keys.folder / "mana")
        options = ("--settings", str(settings), "--connect", endpoint, "--ros-connect", robot_endpoint)
        spawn("services.gateway_ros2", *options, "--ros-identity", identity)
        samples: list[Message] = []
        bus.subscribe(keys.sensor("mana", "imu", "sample"), samples.append)
        with open_as(robot_keys.folder / "mana", robot_endpoint, wait_s=30.0) as robot_bus:
            robot = Robot(robot_bus)

            def is_received() -> bool:
                robot.publish("/imu/data", "sensor_msgs/msg/Imu", robot.imu(wall_ns()))
                return bool(samples)

            wait_until(is_received, 60.0, "a sample on the bus")

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 1 with a small master of this project, a real router and a DFPC host."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.bus.message import pack
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.errors import CdffError
from services.dfpc_host.inputs import decode_sample
from services.gateway_ros1.gateway import Gateway
from services.gateway_ros1.node import Ros1Node
from services.gateway_ros1.settings import Ros1Settings
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes
from tests.integration.conftest import Spawn, wait_until
from tests.support.ros1_master import Master

pytestmark = pytest.mark.integration

PROFILE = str(Path(__file__).parent / "ros2_requests.yaml")
_TYPES = RosTypes(1)
_CAMERAS = {
    "robot": "mana",
    "inputs": [
        {
            "topic": f"/cam/{name}",
            "type": "sensor_msgs/msg/Image",
            "stream": f"cam/{name}",
            "frame": "mana/cam",
            "camera_info": "/cam/camera_info",
        }
        for name in ("colour", "grey")
    ],
}
_PARAMETERS = {"robot": "mana", "parameters": {"position_manager": ["odometry.lidar_scale"]}}
_SERVER_KEY = "/cdff_gateway/position_manager/odometry/lidar_scale"


@pytest.fixture
def bus(router: object, endpoint: str) -> Iterator[Bus]:
    with Bus.open(endpoint, name="test", wait_s=20.0) as bus:
        yield bus


@contextmanager
def running(settings: dict[str, Any], master: Master, endpoint: str) -> Iterator[Gateway]:
    """Yield a gateway that runs in a thread."""
    stop = threading.Event()
    with Bus.open(endpoint, name="gateway", wait_s=20.0) as bus, Client(endpoint) as client:
        gateway = Gateway(Ros1Settings.model_validate(settings), bus, client, master.uri, "127.0.0.1")
        thread = threading.Thread(target=gateway.run, args=(stop,))
        thread.start()
        try:
            wait_until(lambda: gateway.status()["master"]["registered"], 10.0, "the gateway is registered")
            yield gateway
        finally:
            stop.set()
            thread.join()


def _camera_info(stamp_ns: int) -> Any:
    make = _TYPES.make
    K = np.array([[50.0, 0.0, 3.0], [0.0, 50.0, 2.0], [0.0, 0.0, 1.0]])
    return make(
        "sensor_msgs/CameraInfo",
        header=_TYPES.header(stamp_ns, "cam"),
        height=4,
        width=6,
        distortion_model="plumb_bob",
        D=np.zeros(5),
        K=K.ravel(),
        R=np.eye(3).ravel(),
        P=np.hstack([K, np.zeros((3, 1))]).ravel(),
        binning_x=0,
        binning_y=0,
        roi=make("sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False),
    )


def test_two_cameras_can_share_the_topic_of_their_calibration(bus: Bus, endpoint: str) -> None:
    with Master() as master, running(_CAMERAS, master, endpoint) as gateway:
        focal_lengths: dict[str, float] = {}
        for name in ("colour", "grey"):

            def on_sample(message: Message, name: str = name) -> None:
                frame = decode_sample(message, name, "Frame").value
                focal_lengths[name] = float(frame.camera_matrix[0, 0])

            bus.subscribe(keys.sensor("mana", "cam", name), on_sample)
        topics = sorted(str(arguments[1]) for arguments in master.called("registerSubscriber"))
        assert topics == ["/cam/camera_info", "/cam/colour", "/cam/grey"]
        robot = Ros1Node(master.uri, "127.0.0.1", "/camera", _TYPES)
        robot.start()
        for topic in topics:
            kind = "sensor_msgs/msg/" + ("CameraInfo" if topic.endswith("info") else "Image")
            robot.declare_publisher(topic, kind, latched=False)
            gateway._node.update_publishers(topic, [robot._slave.uri])
        wait_until(lambda: len(robot.connections()) == 3, 10.0, "the gateway is connected")

        def both_are_calibrated() -> bool:
            stamp_ns = wall_ns()
            info = Outgoing("/cam/camera_info", "sensor_msgs/msg/CameraInfo", _camera_info(stamp_ns))
            robot.publish(info, latched=False)
            for topic in ("/cam/colour", "/cam/grey"):
                image = _TYPES.make(
                    "sensor_msgs/Image",
                    header=_TYPES.header(stamp_ns, "cam"),
                    height=4,
                    width=6,
                    encoding="mono8",
                    is_bigendian=0,
                    step=6,
                    data=np.arange(24, dtype=np.uint8),
                )
                robot.publish(Outgoing(topic, "sensor_msgs/msg/Image", image), latched=False)
            return focal_lengths == {"colour": 50.0, "grey": 50.0}

        wait_until(both_are_calibrated, 10.0, "samples of both cameras with the calibration")
        robot.close()


def test_a_parameter_waits_for_its_dfpc_and_changes_no_other_value(
    bus: Bus, spawn: Spawn, endpoint: str
) -> None:
    def parameters() -> dict[str, Any]:
        try:
            body = bus.call(keys.dfpc_rpc("mana", "position_manager", "describe")).body()
        except CdffError:
            return {}
        found: dict[str, Any] = body["parameters"]
        return found

    def lidar_scale() -> float:
        return float(parameters().get("odometry", {}).get("lidar_scale", 0.0))

    host = ("services.dfpc_host", "--profile", PROFILE, "--process", "mana_position_manager")
    with Master() as master:
        master.parameters[_SERVER_KEY] = 2.5
        with running(_PARAMETERS, master, endpoint) as gateway:
            wait_until(lambda: gateway.status()["parameters"]["pending"], 10.0, "the parameter waits")
            assert gateway.status()["parameters"]["dropped"] == {"unavailable": 1}
            process = spawn(*host)
            wait_until(lambda: lidar_scale() == 2.5, 60.0, "the parameter is set")

            configured = {**parameters(), "clock": {"max_silence_s": 77.0}}
            bus.call(keys.dfpc_rpc("mana", "position_manager", "configure"), payload=pack(configured))
            master.set_parameter(_SERVER_KEY, 3.5)
            wait_until(lambda: lidar_scale() == 3.5, 5.0, "the new value is set")
            assert parameters()["clock"]["max_silence_s"] == 77.0, "it is not a parameter of the gateway"

            master.set_parameter(_SERVER_KEY, b"\1")
            replaced = "a value that is no number is replaced"
            wait_until(lambda: master.parameters[_SERVER_KEY] == 3.5, 5.0, replaced)
            assert gateway.status()["parameters"]["dropped"]["refused"] == 1

            process.terminate()
            wait_until(lambda: gateway.status()["parameters"]["pending"], 20.0, "the DFPC has ended")
            spawn(*host)
            wait_until(lambda: lidar_scale() == 3.5, 60.0, "the parameter is set after the restart")

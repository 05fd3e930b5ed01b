# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 1 as a process, with Debian's roscore, rospy and tools as the robot."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Reader, Writer

from cdff_common.bus import Bus, Message, keys
from cdff_common.client import Client
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode
from cdff_common.errors import CdffError, UnavailableError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import Time, TransformWithCovariance
from cdff_dev.ports import free_port
from services.dfpc_host.inputs import decode_sample
from services.ros_messages.message_types import RosTypes
from tests.integration.conftest import ROOT, process_starter, wait_until
from tests.support.gateway_traffic import publish_navigation_map, publish_product
from tests.support.orchestrated_products import patch, put

pytestmark = [pytest.mark.integration, pytest.mark.slow]

PROFILE = str(Path(__file__).parent / "ros2_requests.yaml")
_PYTHON = "/usr/bin/python3"
_PAGE = (ROOT / "docs" / "how-to" / "ros1.md").read_text(encoding="utf-8")
_SETTINGS = _PAGE.partition("```yaml\n")[2].partition("```")[0]
_COMMAND = next(line for line in _PAGE.splitlines() if line.startswith("cdff service gateway_ros1"))
_NODE = "/cdff_gateway"


class Robot:
    """Processes of a robot with ROS 1."""

    def __init__(self, folder: Path) -> None:
        self._folder, self._port = folder, free_port()
        self.uri = f"http://127.0.0.1:{self._port}"
        self.environment = {
            "PATH": "/usr/bin:/bin",
            "HOME": str(folder),
            "ROS_MASTER_URI": self.uri,
            "ROS_IP": "127.0.0.1",
        }
        self._master: subprocess.Popen[bytes] | None = None

    def start_master(self) -> None:
        with (self._folder / "master.log").open("ab") as log:
            self._master = subprocess.Popen(
                ["/usr/bin/rosmaster", "--core", "-p", str(self._port)],
                env=self.environment,
                stdout=log,
                stderr=log,
            )
        wait_until(lambda: self.run("rosparam", "list").returncode == 0, 40.0, "the master answers")

    def stop_master(self) -> None:
        if self._master is not None:
            self._master.kill()
            self._master.wait()

    def run(self, *command: str, timeout_s: float = 60.0) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command, env=self.environment, capture_output=True, text=True, timeout=timeout_s, check=False
        )

    @contextmanager
    def peer(self) -> Iterator[subprocess.Popen[str]]:
        """A program with rospy."""
        program = str(Path(__file__).with_name("ros1_peer.py"))
        content = encode(Time.from_ns(1_000_000), "uper", "Time").hex()
        with subprocess.Popen(
            [_PYTHON, program, content],
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        ) as process:
            try:
                yield process
            finally:
                process.kill()


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Robot]:
    found = subprocess.run(
        [_PYTHON, "-c", "import rospy, nav_msgs, tf2_msgs"], check=False, capture_output=True
    )
    if found.returncode or shutil.which("rosmaster", path="/usr/bin") is None:
        pytest.skip("Debian's ROS 1 is not installed; make peers installs it")
    robot = Robot(tmp_path_factory.mktemp("robot"))
    robot.start_master()
    yield robot
    robot.stop_master()


@pytest.fixture(scope="module")
def bus(robot: Robot, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Bus]:
    """A router, a DPM with a patch, an orchestrator, a DFPC and the gateway."""
    folder, endpoint = tmp_path_factory.mktemp("ros1"), f"tcp/127.0.0.1:{free_port()}"
    settings = folder / "gateway.yaml"
    settings.write_text(_SETTINGS)
    noun, *options = shlex.split(_COMMAND.replace("gateway.yaml", str(settings)))[1:]
    with process_starter(endpoint, folder, ROS_MASTER_URI=robot.uri) as spawn:
        spawn("services.router")
        spawn("services.dpm", "--profile", PROFILE, "--http", f"127.0.0.1:{free_port()}")
        spawn("services.orchestrator", "--profile", PROFILE)
        spawn("services.dfpc_host", "--profile", PROFILE, "--process", "mana_position_manager")
        spawn("cdff_common.cli", noun, *options)
        with Bus.open(endpoint, name="producer", wait_s=20) as bus, Client(endpoint) as client:
            names = ("dpm", "orchestrator", "position_manager", "gateway_ros1")
            awaited_tokens = {keys.alive("mana", s) for s in names}
            wait_until(lambda: awaited_tokens <= bus.alive(keys.alive("mana", "*")), 300, "start-up")
            put(bus, "dem", patch(0.0, 1.0, age_s=10.0))
            wait_until(lambda: _has_dem(client), 60, "the DPM has compiled its kernels")
            wait_until(lambda: status(bus)["master"]["registered"], 20, "the gateway is registered")
            yield bus


def _has_dem(client: Client) -> bool:
    try:
        client.request("dem", robot="mana", region="bbox:0,0,1,1")
    except UnavailableError:
        return False
    return True


def status(bus: Bus) -> dict[str, Any]:
    try:
        body: dict[str, Any] = bus.call(keys.gateway_status("mana", "gateway_ros1")).body()
    except CdffError:
        return {"master": {"registered": False}}
    return body


def publish_products(bus: Bus) -> None:
    stamp_ns = wall_ns() // 1000 * 1000
    T = UncertainTransform(se3.transform(np.eye(3), np.array([1.0, 2.0, 3.0])), 0.25 * np.eye(6))
    pose = TransformWithCovariance.from_transform(T, parent="mana/odom", child="mana/base", stamp_ns=stamp_ns)
    publish_product(bus, "position_manager/pose", pose, stamp_ns, frame="mana/odom", child="mana/base")
    publish_navigation_map(bus)


def exchange(bus: Bus, robot: Robot) -> dict[str, Any]:
    """Run the peer until it has everything; return the JSON that it prints."""
    with robot.peer() as peer:

        def done() -> bool:
            publish_products(bus)
            return peer.poll() is not None

        wait_until(done, 90.0, "the peer has all messages")
        assert peer.stdout is not None
        assert peer.stderr is not None
        assert peer.returncode == 0, peer.stderr.read()[-3000:]
        result: dict[str, Any] = json.loads(peer.stdout.read().splitlines()[-1])
    return result


def test_a_program_with_rospy_gives_sensors_and_has_products_and_a_dem(bus: Bus, robot: Robot) -> None:
    samples: dict[str, list[Message]] = {}
    for stream in ("imu/sample", "lidar/scan", "mast/pose"):
        bus.subscribe(keys.sensor("mana", *stream.split("/")), samples.setdefault(stream, []).append)
    found = exchange(bus, robot)
    assert found["pose"] == ["odom", 3.0]
    assert found["tf"] == ["odom", 1.0]
    assert found["map"] == ["map", [100, 0, 0, -1, 0, 50]]
    assert found["bits"][0] == "TransformWithCovariance"
    assert found["dem"] == ["map", [1.0]]
    imu = decode_sample(samples["imu/sample"][0], "imu", "IMUSensors")
    np.testing.assert_array_equal(imu.value.acc, [0.25, 0.0, 0.0])
    scan = decode_sample(samples["lidar/scan"][0], "scan", "LidarScan")
    np.testing.assert_array_equal(scan.value.points_m, [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]])
    mast = decode_sample(samples["mast/pose"][0], "pose", "TransformWithCovariance")
    np.testing.assert_array_equal(mast.value.data.translation, [0.0, 0.0, 1.5])

    def counted() -> bool:
        inputs = status(bus)["inputs"]
        return bool(inputs["/odom"]["dropped"].get("type")) and bool(
            inputs["/tf mast/pose"]["dropped"].get("frame_tree")
        )

    wait_until(counted, 10.0, "the other type and the loop are counted")
    assert "topic types do not match" in status(bus)["inputs"]["/odom"]["last_fault"]
    assert status(bus)["inputs"]["/imu/data"]["least_age_ms"] < 5000.0


def test_the_tools_of_ros_show_the_gateway(bus: Bus, robot: Robot) -> None:
    info = robot.run("rostopic", "info", "/map").stdout
    assert "Type: nav_msgs/OccupancyGrid" in info
    assert _NODE in info
    assert "xmlrpc reply from" in robot.run("rosnode", "ping", "-c", "1", _NODE).stdout
    node = robot.run("rosnode", "info", _NODE).stdout
    assert "* /cdff/pose [geometry_msgs/PoseWithCovarianceStamped]" in node
    assert "* /cdff/get_dem" in node
    assert robot.run("rosservice", "type", "/cdff/get_dem").stdout.strip() == "grid_map_msgs/GetGridMap"
    publish_products(bus)
    echoed = robot.run("rostopic", "echo", "-n", "1", "/map").stdout
    assert "data: [100, 0, 0, -1, 0, 50]" in echoed


def test_rosbag_records_a_product_and_plays_a_sensor(bus: Bus, robot: Robot, tmp_path: Path) -> None:
    publish_products(bus)
    bag = tmp_path / "map.bag"
    recorded = robot.run("rosbag", "record", "-l", "1", "-O", str(bag), "/map")
    assert recorded.returncode == 0, recorded.stderr
    with Reader(bag) as reader:
        ((connection, _, data),) = list(reader.messages())
    types = RosTypes(1)
    grid = types.deserialize(data, "nav_msgs/msg/OccupancyGrid")
    assert (connection.topic, list(grid.data)) == ("/map", [100, 0, 0, -1, 0, 50])

    played, transform = tmp_path / "tf.bag", "geometry_msgs/TransformStamped"
    with Writer(played) as writer:
        tree = writer.add_connection("/tf", "tf2_msgs/msg/TFMessage", typestore=types.store)
        for i in range(100):
            stamp_ns = wall_ns() + 50_000_000 * i
            zero = types.vector(np.zeros(3))
            rotation = types.quaternion(np.array([0.0, 0.0, 0.0, 1.0]))
            motion = types.make("geometry_msgs/Transform", translation=zero, rotation=rotation)
            header = types.header(stamp_ns, "base_link")
            edge = types.make(transform, header=header, child_frame_id="mast", transform=motion)
            message = types.make("tf2_msgs/TFMessage", transforms=[edge])
            writer.write(tree, stamp_ns, types.serialize(message, "tf2_msgs/msg/TFMessage"))
    before = status(bus)["inputs"]["/tf mast/pose"]["received"]
    assert robot.run("rosbag", "play", str(played)).returncode == 0
    wait_until(lambda: status(bus)["inputs"]["/tf mast/pose"]["received"] > before, 10.0, "played messages")


def test_a_parameter_of_the_server_configures_a_dfpc_and_is_replaced_if_refused(
    bus: Bus, robot: Robot
) -> None:
    key = f"{_NODE}/position_manager/odometry/lidar_scale"

    def value() -> float:
        body = bus.call(keys.dfpc_rpc("mana", "position_manager", "describe")).body()
        return float(body["parameters"]["odometry"]["lidar_scale"])

    assert robot.run("rosparam", "set", key, "2.5").returncode == 0
    wait_until(lambda: value() == 2.5, 10.0, "the DFPC has the value")
    assert robot.run("rosparam", "set", key, "-1.0").returncode == 0
    wait_until(
        lambda: robot.run("rosparam", "get", key).stdout.strip() == "2.5", 20.0, "the value is replaced"
    )
    assert value() == 2.5
    wait_until(lambda: status(bus)["parameters"]["dropped"] == {"refused": 1}, 5.0, "the refusal is counted")


def test_a_restart_of_the_master_is_survived(bus: Bus, robot: Robot) -> None:
    robot.stop_master()
    wait_until(lambda: not status(bus)["master"]["registered"], 20.0, "the loss is reported")
    robot.start_master()
    wait_until(lambda: status(bus)["master"]["registered"], 20.0, "the gateway is registered again")
    assert exchange(bus, robot)["pose"] == ["odom", 3.0]


@pytest.fixture(autouse=True)
def _environment_of_the_gateway(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("ROS_MASTER_URI", "ROS_IP"):
        if name in os.environ:
            monkeypatch.delenv(name)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The gateway to ROS 2 as a process on a real router: sensors in, products out, faults counted."""

from __future__ import annotations

import json
import os
import shlex
import subprocess
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common.bus import Bus, Message, keys
from cdff_common.clock import wall_ns
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.types import FramePair, TransformWithCovariance
from cdff_dev.ports import free_port
from services.dfpc_host.inputs import decode_sample
from services.gateway_ros2 import rmw_zenoh
from services.ros_messages.encoding import Target
from services.ros_messages.image_encoders import pair_images
from services.ros_messages.message_types import RosTypes
from services.ros_messages.type_hashes import message_hash
from tests.integration.conftest import Spawn, wait_until
from tests.support.gateway_traffic import publish_product

pytestmark = [pytest.mark.integration, pytest.mark.slow]

_ROOT = Path(__file__).resolve().parents[2]
_IMU, _CLOUD, _POSE = (
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/PointCloud2",
    "geometry_msgs/msg/PoseWithCovarianceStamped",
)
_ODOMETRY, _IMAGE, _INFO, _TF = (
    "nav_msgs/msg/Odometry",
    "sensor_msgs/msg/Image",
    "sensor_msgs/msg/CameraInfo",
    "tf2_msgs/msg/TFMessage",
)
#: Settings and command of the page.
_PAGE = (_ROOT / "docs" / "how-to" / "ros2.md").read_text(encoding="utf-8")
_SETTINGS = _PAGE.partition("```yaml\n")[2].partition("```")[0]
_COMMAND = next(line for line in _PAGE.splitlines() if line.startswith("cdff service gateway_ros2"))
_STATUS = _PAGE.partition("```python\n")[2].partition("```")[0]


class Robot:
    """A program on the robot, with the messages of rosbags and a connection of its own."""

    def __init__(self, bus: Bus) -> None:
        self.bus, self.types = bus, RosTypes(2)
        self._seq = 0

    def key(self, topic: str, type_name: str) -> str:
        return rmw_zenoh.data_key(0, topic, type_name, message_hash(self.types.store.fielddefs, type_name))

    def publish(self, topic: str, type_name: str, message: Any, *, key: str = "", cut: int = 0) -> None:
        data = bytes(self.types.serialize(message, type_name))
        attachment = rmw_zenoh.Attachment(self._seq, wall_ns(), bytes(16)).to_bytes()
        self._seq += 1
        self.bus.publish(
            key or self.key(topic, type_name),
            data[: len(data) - cut],
            encoding="application/cdr",
            attachment=attachment,
        )

    def received(self, topic: str, type_name: str) -> list[Any]:
        messages: list[Any] = []

        def take(message: Message) -> None:
            assert rmw_zenoh.Attachment.from_bytes(message.attachment).seq > 0
            messages.append(self.types.store.deserialize_cdr(message.payload, type_name))

        self.bus.subscribe(self.key(topic, type_name), take, depth=100)
        return messages

    def imu(self, stamp_ns: int, frame_id: str = "imu_link") -> Any:
        zero = np.zeros(9)
        return self.types.make(
            "sensor_msgs/Imu",
            header=self.types.header(stamp_ns, frame_id),
            orientation=self.types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
            orientation_covariance=zero,
            angular_velocity=self.types.vector(np.array([0.0, 0.0, 0.125])),
            angular_velocity_covariance=zero,
            linear_acceleration=self.types.vector(np.array([0.25, 0.5, 9.75])),
            linear_acceleration_covariance=zero,
        )

    def odometry(self, stamp_ns: int, q_xyzw: list[float]) -> Any:
        make, zero = self.types.make, self.types.vector(np.zeros(3))
        position = self.types.vector(np.array([1.0, 2.0, 3.0]), "Point")
        pose = make(
            "geometry_msgs/Pose", position=position, orientation=self.types.quaternion(np.array(q_xyzw))
        )
        twist = make("geometry_msgs/Twist", linear=zero, angular=zero)
        return make(
            "nav_msgs/Odometry",
            header=self.types.header(stamp_ns, "odom"),
            child_frame_id="base_link",
            pose=make("geometry_msgs/PoseWithCovariance", pose=pose, covariance=np.ravel(np.eye(6))),
            twist=make("geometry_msgs/TwistWithCovariance", twist=twist, covariance=np.zeros(36)),
        )

    def cloud(self, stamp_ns: int, points: np.ndarray[Any, Any]) -> Any:
        fields = [
            self.types.make("sensor_msgs/PointField", name=name, offset=4 * i, datatype=7, count=1)
            for i, name in enumerate("xyz")
        ]
        return self.types.make(
            "sensor_msgs/PointCloud2",
            header=self.types.header(stamp_ns, "lidar"),
            height=1,
            width=len(points),
            fields=fields,
            is_bigendian=False,
            point_step=12,
            row_step=12 * len(points),
            data=np.ascontiguousarray(points, np.float32).reshape(-1).view(np.uint8),
            is_dense=True,
        )

    def image(self, stamp_ns: int) -> Any:
        return self.types.make(
            "sensor_msgs/Image",
            header=self.types.header(stamp_ns, "cam"),
            height=4,
            width=6,
            encoding="mono8",
            is_bigendian=0,
            step=6,
            data=np.arange(24, dtype=np.uint8),
        )

    def camera_info(self, stamp_ns: int) -> Any:
        roi = self.types.make(
            "sensor_msgs/RegionOfInterest", x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
        )
        K = np.array([[50.0, 0.0, 3.0], [0.0, 50.0, 2.0], [0.0, 0.0, 1.0]])
        return self.types.make(
            "sensor_msgs/CameraInfo",
            header=self.types.header(stamp_ns, "cam"),
            height=4,
            width=6,
            distortion_model="plumb_bob",
            d=np.zeros(5),
            k=K.ravel(),
            r=np.eye(3).ravel(),
            p=np.hstack([K, np.zeros((3, 1))]).ravel(),
            binning_x=0,
            binning_y=0,
            roi=roi,
        )


@pytest.fixture
def bus(router: object, endpoint: str) -> Iterator[Bus]:
    with Bus.open(endpoint, name="test", wait_s=20.0) as bus:
        yield bus


@pytest.fixture
def gateway(bus: Bus, spawn: Spawn, tmp_path: Path) -> None:
    path = tmp_path / "gateway.yaml"
    path.write_text(_SETTINGS)
    noun, *options = shlex.split(_COMMAND.replace("gateway.yaml", str(path)))[1:]
    spawn("cdff_common.cli", noun, *options)
    token = keys.alive("mana", "gateway_ros2")
    wait_until(lambda: bus.alive(token), 60.0, "the gateway is ready")


def status(bus: Bus) -> dict[str, Any]:
    body: dict[str, Any] = bus.call(keys.gateway_status("mana", "gateway_ros2")).body()
    return body


def publish_pose(bus: Bus, seq: int) -> None:
    stamp_ns = wall_ns() // 1000 * 1000
    transform = UncertainTransform(se3.transform(np.eye(3), np.array([1.0, 2.0, 3.0])), 0.25 * np.eye(6))
    value = TransformWithCovariance.from_transform(
        transform, parent="mana/odom", child="mana/base", stamp_ns=stamp_ns, producer="position_manager"
    )
    publish_product(
        bus, "position_manager/pose", value, stamp_ns, frame="mana/odom", child="mana/base", seq=seq
    )


@pytest.mark.usefixtures("gateway")
def test_sensors_of_the_robot_become_samples_and_products_become_topics(bus: Bus) -> None:
    robot = Robot(bus)
    samples: dict[str, list[Message]] = {}
    for stream in ("imu/sample", "lidar/scan", "wheels/odometry", "cam/frame"):
        bus.subscribe(keys.sensor("mana", *stream.split("/")), samples.setdefault(stream, []).append)
    poses, transforms = robot.received("/cdff/pose", _POSE), robot.received("/tf", _TF)
    points = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], np.float32)
    robot.publish("/cam/camera_info", _INFO, robot.camera_info(wall_ns()))

    def exchanged() -> bool:
        now_ns = wall_ns()
        robot.publish("/imu/data", _IMU, robot.imu(now_ns))
        robot.publish("/lidar/points", _CLOUD, robot.cloud(now_ns, points))
        robot.publish("/odom", _ODOMETRY, robot.odometry(now_ns, [0.0, 0.0, 0.0, 1.0]))
        robot.publish("/cam/image_raw", _IMAGE, robot.image(now_ns))
        publish_pose(bus, now_ns % 1000)
        return all(samples.values()) and bool(poses) and bool(transforms)

    wait_until(exchanged, 20.0, "every topic and stream has a message")
    imu = decode_sample(samples["imu/sample"][0], "imu", "IMUSensors")
    assert imu.frame == "mana/imu"
    np.testing.assert_array_equal(imu.value.acc, [0.25, 0.5, 9.75])
    np.testing.assert_array_equal(imu.value.gyro, [0.0, 0.0, 0.125])
    assert samples["lidar/scan"][0].encoding.startswith("application/vnd.cdff+msgpack;LidarScan")
    scan = decode_sample(samples["lidar/scan"][0], "scan", "LidarScan")
    np.testing.assert_array_equal(scan.value.points_m, points)
    odometry = decode_sample(samples["wheels/odometry"][0], "odometry", "TransformWithCovariance")
    assert (odometry.frame, odometry.child) == ("mana/odom", "mana/base")
    np.testing.assert_array_equal(odometry.value.data.translation, [1.0, 2.0, 3.0])
    image = decode_sample(samples["cam/frame"][-1], "frame", "Frame")
    np.testing.assert_array_equal(image.value.image, np.arange(24).reshape(4, 6))
    assert image.value.camera_matrix[0, 0] == 50.0
    assert (poses[0].header.frame_id, poses[0].pose.pose.position.z) == ("odom", 3.0)
    np.testing.assert_allclose(poses[0].pose.covariance, 0.25 * np.ravel(np.eye(6)))
    (edge,) = transforms[0].transforms
    assert (edge.header.frame_id, edge.child_frame_id) == ("odom", "base_link")

    tokens = bus.alive("@ros2_lv/0/**")
    kinds = {tuple(t.split("/")[i] for i in (5, 9)) for t in tokens if len(t.split("/")) == 13}
    assert ("MP", "%tf") in kinds
    assert ("MS", "%imu%data") in kinds
    assert any(t.endswith("/NN/%/%/cdff_gateway") for t in tokens)


@pytest.mark.usefixtures("gateway")
def test_images_of_two_cameras_and_positions_become_pairs_and_poses(bus: Bus) -> None:
    robot = Robot(bus)
    samples: dict[str, list[Message]] = {}
    for stream in ("nav/pair", "gnss/fix"):
        bus.subscribe(keys.sensor("mana", *stream.split("/")), samples.setdefault(stream, []).append)
    images = np.random.default_rng(0).integers(0, 255, (2, 30, 40)).astype(np.uint8)
    K = np.array([[40.0, 0.0, 20.0], [0.0, 40.0, 15.0], [0.0, 0.0, 1.0]])
    target = Target("/nav", "mana", "mana/nav_left", lambda frame: frame.removeprefix("mana/"), {}, {})

    def exchanged() -> bool:
        stamp_ns = wall_ns() // 1000 * 1000
        pair = FramePair.from_images(
            *images, baseline_m=0.25, camera_matrix=K, stamp_ns=stamp_ns, sensor="mana/nav_left"
        )
        for out in pair_images(pair, target, robot.types, stamp_ns).messages:
            robot.publish(out.topic, out.type_name, out.message)
        fix = robot.types.make(
            "sensor_msgs/NavSatFix",
            header=robot.types.header(stamp_ns, "gnss"),
            status=robot.types.make("sensor_msgs/NavSatStatus", status=0, service=1),
            latitude=43.57,
            longitude=1.48,
            altitude=152.0,
            position_covariance=np.diag([4.0, 9.0, 16.0]).ravel(),
            position_covariance_type=2,
        )
        robot.publish("/fix", "sensor_msgs/msg/NavSatFix", fix)
        return all(samples.values())

    wait_until(exchanged, 20.0, "a pair and a position")
    pair = decode_sample(samples["nav/pair"][0], "pair", "FramePair")
    assert pair.frame == "mana/nav_left"
    np.testing.assert_array_equal(pair.value.left.image, images[0])
    np.testing.assert_array_equal(pair.value.right.image, images[1])
    assert pair.value.baseline == pytest.approx(0.25)
    fix = decode_sample(samples["gnss/fix"][0], "fix", "TransformWithCovariance")
    assert (fix.frame, fix.child) == ("site", "mana/gnss")
    np.testing.assert_allclose(fix.value.data.translation, [0.0, 0.0, 2.0], atol=1e-3)


@pytest.mark.usefixtures("gateway")
def test_the_page_shows_how_to_read_the_status(
    endpoint: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("CDFF_CONNECT", endpoint)
    exec(compile(_STATUS, "ros2.md", "exec"), {})
    assert "'/imu/data': {'type': 'sensor_msgs/msg/Imu'" in capsys.readouterr().out


@pytest.mark.usefixtures("gateway")
def test_bad_messages_are_counted_with_the_reason_and_the_gateway_goes_on(bus: Bus) -> None:
    robot = Robot(bus)
    samples: list[Message] = []
    bus.subscribe(keys.sensor("mana", "imu", "sample"), samples.append)
    good = robot.imu(wall_ns())
    wrong_hash = rmw_zenoh.data_key(0, "/imu/data", _IMU, f"RIHS01_{'0' * 64}")
    robot.publish("/imu/data", _IMU, good, key=wrong_hash)
    robot.publish("/imu/data", _IMU, good, cut=40)
    robot.publish("/imu/data", _IMU, robot.imu(wall_ns(), "elsewhere"))
    robot.publish("/imu/data", _IMU, robot.imu(0))
    huge_text = bytes.fromhex("00010000" + "00" * 8 + "ffffffff")  # a frame of 4 GB
    bus.publish(robot.key("/imu/data", _IMU), huge_text, encoding="application/cdr")
    bus.publish(robot.key("/imu/data", _IMU), bytes(200_000), encoding="application/cdr")
    nan = float("nan")
    robot.publish("/odom", _ODOMETRY, robot.odometry(wall_ns(), [nan, nan, nan, nan]))
    other = rmw_zenoh.Node(0, "abc", "other")
    bus.declare_token(other.entity_token(1, "MP", "/odom", _POSE, "RIHS01_0", rmw_zenoh.QOS_DEFAULT))

    def counted() -> bool:
        state = status(bus)
        dropped = state["inputs"]["/imu/data"]["dropped"]
        expected = {"type_hash": 1, "decoding": 3, "content": 1, "size": 1}
        conflicts = list(state["type_conflicts"])
        odometry = state["inputs"]["/odom"]["dropped"]
        return dropped == expected and odometry == {"content": 1} and conflicts == ["/odom"]

    wait_until(counted, 15.0, "every fault is counted")
    assert samples == []
    robot.publish("/imu/data", _IMU, robot.imu(wall_ns()))
    wait_until(lambda: samples, 10.0, "a sample after the faults")


@pytest.mark.usefixtures("gateway")
def test_another_implementation_of_ros_2_exchanges_messages_with_the_gateway(
    bus: Bus, endpoint: str, tmp_path: Path
) -> None:
    default = _ROOT / "build" / "ros2-peers" / "bin" / "python"
    python = os.environ.get("CDFF_ROS2_PEER_PYTHON", str(default))
    if not Path(python).exists():
        pytest.skip("pyzeros is not installed; make peers installs it")
    samples: list[Message] = []
    bus.subscribe(keys.sensor("mana", "imu", "sample"), samples.append)
    command = [python, str(Path(__file__).with_name("ros2_peer.py")), endpoint]
    environment = {"PATH": os.environ["PATH"], "ROS_DOMAIN_ID": "0"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, env=environment, text=True, cwd=tmp_path) as peer:
        try:
            seq = 0

            def done() -> bool:
                nonlocal seq
                publish_pose(bus, seq)
                seq += 1
                return peer.poll() is not None

            wait_until(done, 120.0, "the peer has three poses")
            assert peer.stdout is not None
            lines = [json.loads(line) for line in peer.stdout.read().splitlines()]
        finally:
            peer.kill()
    assert [line["position"] for line in lines] == [[1.0, 2.0, 3.0]] * 3
    assert lines[0]["frame_id"] == "odom"
    np.testing.assert_allclose(lines[0]["covariance"], 0.25 * np.ravel(np.eye(6)))
    assert samples
    imu = decode_sample(samples[0], "imu", "IMUSensors")
    np.testing.assert_array_equal(imu.value.acc, [0.25, 0.5, 9.75])
    assert not status(bus)["inputs"]["/imu/data"]["dropped"]


def test_cdff_up_starts_the_gateway_of_a_profile_and_the_dpm_has_its_metrics(
    endpoint: str, spawn: Spawn, tmp_path: Path
) -> None:
    (tmp_path / "gateway.yaml").write_text(_SETTINGS)
    profile = tmp_path / "profile.yaml"
    profile.write_text(
        "name: gate\nrobots:\n  - id: mana\n    gateways: {gateway_ros2: gateway.yaml}\n"
        "    frames: [{parent: mana/base, child: mana/imu}]\n"
        "    sensors: {imu: {kind: imu, frame: mana/imu, streams: {sample: IMUSensors}}}\n"
    )
    http = f"127.0.0.1:{free_port()}"
    options = ("--profile", str(profile), "--connect", endpoint, "--http", http)
    spawn("cdff_common.cli", "up", *options, "--data-dir", str(tmp_path / "up"))

    def metrics() -> str:
        try:
            with urllib.request.urlopen(f"http://{http}/metrics", timeout=10) as answer:
                text: str = answer.read().decode()
        except OSError:
            return ""
        return text

    start = 'cdff_gateway_received_total{robot="mana",gateway="gateway_ros2",direction="in",topic="/imu/data"'
    wait_until(lambda: start in metrics(), 90.0, "the DPM has the counters of the gateway")
    with urllib.request.urlopen(f"http://{http}/api/v1/gateways", timeout=10) as answer:
        topics = {(t["robot"], t["direction"], t["topic"]): t for t in json.load(answer)["items"]}
    assert topics["mana", "in", "/imu/data"]["received"] == 0
    assert topics["mana", "out", "/cdff/pose"]["dropped"] == {}
    with Bus.open(endpoint, name="test") as bus:
        wait_until(lambda: status(bus)["frame_tree"]["dpm_frames"] == 1, 30.0, "the frames of the DPM")

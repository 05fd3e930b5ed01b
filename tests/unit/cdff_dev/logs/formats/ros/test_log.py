# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""ROS bags are read as logs; the bags are written by rosbags."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore

from cdff_dev.logs import open_log

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
START_NS = 1_600_000_000_000_000_000
PERIOD_NS = 100_000_000
Message = tuple[str, str, int, Any]


def header(store: Any, stamp_ns: int, frame: str = "base_link") -> Any:
    time = store.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 1_000_000_000))
    sequence = {"seq": 0} if store is ROS1 else {}
    return store.types["std_msgs/msg/Header"](stamp=time, frame_id=frame, **sequence)


def vector(store: Any, *xyz: float) -> Any:
    return store.types["geometry_msgs/msg/Vector3"](*xyz)


def imu(store: Any, stamp_ns: int) -> Any:
    return store.types["sensor_msgs/msg/Imu"](
        header=header(store, stamp_ns, "Imu_Link"),
        orientation=store.types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0),
        orientation_covariance=np.zeros(9),
        angular_velocity=vector(store, 0.1, 0.2, 0.3),
        angular_velocity_covariance=np.zeros(9),
        linear_acceleration=vector(store, 1.0, 2.0, 9.8),
        linear_acceleration_covariance=np.zeros(9),
    )


def odometry(store: Any, stamp_ns: int, variance: float) -> Any:
    types = store.types
    pose = types["geometry_msgs/msg/Pose"](
        types["geometry_msgs/msg/Point"](1.0, 2.0, 3.0),
        types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(0.5), np.cos(0.5)),
    )
    twist = types["geometry_msgs/msg/Twist"](vector(store, 0, 0, 0), vector(store, 0, 0, 0))
    return types["nav_msgs/msg/Odometry"](
        header=header(store, stamp_ns, "odom"),
        child_frame_id="base_link",
        pose=types["geometry_msgs/msg/PoseWithCovariance"](pose, np.ravel(np.eye(6) * variance)),
        twist=types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36)),
    )


def write_ros1(path: Path, messages: list[Message]) -> Path:
    bag = Writer1(path.with_suffix(".bag"))
    bag.set_compression(Writer1.CompressionFormat.LZ4)
    with bag as writer:
        _write(writer, messages, lambda t: writer.add_connection(*t, typestore=ROS1), ROS1.serialize_ros1)
    return path.with_suffix(".bag")


def write_ros2(path: Path, messages: list[Message], storage: StoragePlugin) -> Path:
    with Writer2(path, version=9, storage_plugin=storage) as writer:
        _write(writer, messages, lambda t: writer.add_connection(*t, typestore=ROS2), ROS2.serialize_cdr)
    return path


def _write(
    writer: Any,
    messages: list[Message],
    connect: Callable[[tuple[str, str]], Any],
    serialize: Callable[[Any, str], Any],
) -> None:
    connections: dict[tuple[str, str], Any] = {}
    for topic, kind, recorded_ns, message in messages:
        if (topic, kind) not in connections:
            connections[topic, kind] = connect((topic, kind))
        writer.write(connections[topic, kind], recorded_ns, serialize(message, kind))


def drive(store: Any) -> list[Message]:
    """Three samples of an IMU and wheels; the wheels' samples are recorded a period late."""
    messages: list[Message] = []
    for k in range(3):
        stamp_ns = START_NS + k * PERIOD_NS
        messages.append(("/imu/data", "sensor_msgs/msg/Imu", stamp_ns, imu(store, stamp_ns)))
        wheels = odometry(store, stamp_ns, 0.01 * k)
        messages.append(("/odom", "nav_msgs/msg/Odometry", stamp_ns + PERIOD_NS + 5_000_000, wheels))
    text = store.types["std_msgs/msg/String"]("x")
    messages.append(("/chatter", "std_msgs/msg/String", START_NS, text))
    return sorted(messages, key=lambda m: m[2])


@pytest.fixture(params=["ros1", "sqlite3", "mcap", "mcap file"])
def bag(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    if request.param == "ros1":
        return write_ros1(tmp_path / "rover", drive(ROS1))
    storage = StoragePlugin.SQLITE3 if request.param == "sqlite3" else StoragePlugin.MCAP
    folder = write_ros2(tmp_path / "rover", drive(ROS2), storage)
    return folder / "rover.mcap" if request.param == "mcap file" else folder


def test_samples_have_the_stamps_of_their_headers_in_order(bag: Path) -> None:
    with closing(open_log(bag)) as log:
        samples = list(log.samples())
    stamps_ns = [START_NS + k * PERIOD_NS for k in range(3)]
    assert [(s.stamp_ns, s.stream) for s in samples] == [
        (stamp_ns, stream) for stamp_ns in stamps_ns for stream in ("/rover/imu_data.imu", "/rover/odom.pose")
    ]
    assert [s.seq for s in samples if s.stream == "/rover/odom.pose"] == [0, 1, 2]


def test_values_are_converted_with_frames_and_covariance(bag: Path) -> None:
    with closing(open_log(bag)) as log:
        sample = next(log.samples(["/rover/imu_data.imu"]))
        poses = list(log.samples(["/rover/odom.pose"]))
    np.testing.assert_allclose(sample.value.gyro, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(sample.value.acc, [1.0, 2.0, 9.8])
    assert sample.header is not None
    assert sample.header.frame == "rover/imu_link"
    pose = poses[2].value
    assert (pose.parent_frame, pose.child_frame) == ("rover/odom", "rover/base_link")
    np.testing.assert_allclose(pose.transform.matrix[:3, 3], [1.0, 2.0, 3.0])
    np.testing.assert_allclose(pose.transform.matrix[0, :2], [np.cos(1.0), -np.sin(1.0)])
    np.testing.assert_allclose(pose.transform.covariance, np.eye(6) * 0.02)
    assert poses[0].value.transform.covariance is None


def test_topics_without_a_conversion_are_listed_with_their_number(bag: Path) -> None:
    with closing(open_log(bag)) as log:
        assert [(name, item.type_name, item.count) for name, item in log.unconverted.items()] == [
            ("/chatter", "std_msgs/msg/String", 1),
            ("/imu/data: orientation, covariances", "sensor_msgs/msg/Imu", 3),
            ("/odom: twist", "nav_msgs/msg/Odometry", 3),
        ]


def test_fields_of_clouds_without_a_place_are_listed(tmp_path: Path) -> None:
    field, types = ROS1.types["sensor_msgs/msg/PointField"], ROS1.types
    names = ("x", "y", "z", "intensity", "rgb", "normal_x")
    cloud = types["sensor_msgs/msg/PointCloud2"](
        header=header(ROS1, START_NS),
        height=1,
        width=2,
        fields=[field(name, 4 * i, 7, 1) for i, name in enumerate(names)],
        is_bigendian=False,
        point_step=24,
        row_step=48,
        data=np.zeros(48, np.uint8),
        is_dense=True,
    )
    kind = "sensor_msgs/msg/PointCloud2"
    bag = write_ros1(tmp_path / "rover", [("/points", kind, START_NS + k, cloud) for k in range(2)])
    with closing(open_log(bag)) as log:
        assert [(name, item.type_name, item.count) for name, item in log.unconverted.items()] == [
            ("/points: rgb, normal_x", kind, 2)
        ]


def test_each_frame_of_the_tree_becomes_a_stream(tmp_path: Path) -> None:
    types = ROS2.types

    def transform(child: str, x: float, stamp_ns: int) -> Any:
        rotation = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
        T = types["geometry_msgs/msg/Transform"](vector(ROS2, x, 0.0, 0.0), rotation)
        return types["geometry_msgs/msg/TransformStamped"](header(ROS2, stamp_ns, "odom"), child, T)

    tree = [
        types["tf2_msgs/msg/TFMessage"]([transform("base", 1.0, START_NS), transform("arm", 2.0, START_NS)]),
        types["tf2_msgs/msg/TFMessage"]([transform("base", 3.0, START_NS + PERIOD_NS)]),
    ]
    messages = [("/tf", "tf2_msgs/msg/TFMessage", START_NS + k * PERIOD_NS, m) for k, m in enumerate(tree)]
    with closing(open_log(write_ros2(tmp_path / "rover", messages, StoragePlugin.MCAP))) as log:
        assert {name: info.count for name, info in log.streams.items()} == {
            "/rover/tf.arm": 1,
            "/rover/tf.base": 2,
        }
        poses = [s.value for s in log.samples(["/rover/tf.base"])]
    assert [p.transform.matrix[0, 3] for p in poses] == [1.0, 3.0]
    assert (poses[0].parent_frame, poses[0].child_frame) == ("rover/odom", "rover/base")


def test_bags_and_mcap_files_of_a_folder_are_one_log_with_a_robot_each(tmp_path: Path) -> None:
    recorded = drive(ROS1)
    write_ros1(tmp_path / "husky", recorded)
    for part, messages in enumerate((recorded[:2], recorded[2:])):
        write_ros1(tmp_path / f"split_{part}", messages)
    folder = write_ros2(tmp_path / "scratch", drive(ROS2), StoragePlugin.MCAP)
    next(folder.glob("*.mcap")).rename(tmp_path / "turtle.mcap")
    (folder / "metadata.yaml").unlink()
    folder.rmdir()
    with open_log(tmp_path) as log:
        counts = dict.fromkeys(("husky", "split_0", "turtle"), 0)
        for name, info in log.streams.items():
            counts[name.split("/")[1]] += info.count
        stamps_ns = [sample.stamp_ns for sample in log.samples()]
        assert set(log.first_samples()) == set(log.streams)
    assert counts["husky"] == counts["split_0"] == counts["turtle"] > 0
    assert stamps_ns == sorted(stamps_ns)
    assert len(stamps_ns) == sum(counts.values())


def test_a_damaged_bag_of_a_folder_is_listed_with_the_others(tmp_path: Path) -> None:
    write_ros1(tmp_path / "husky", drive(ROS1))
    (tmp_path / "broken.bag").write_bytes(b"garbage")
    with open_log(tmp_path) as log:
        assert {name.split("/")[1] for name in log.streams} == {"husky"}
        assert "broken.bag" in log.unconverted["broken.bag"].reason


def test_the_first_sample_of_each_stream_is_that_with_the_earliest_stamp(bag: Path) -> None:
    with open_log(bag) as log:
        for name, sample in log.first_samples().items():
            expected = next(iter(log.samples([name])))
            assert (sample.stream, sample.stamp_ns, sample.seq) == (name, expected.stamp_ns, expected.seq)

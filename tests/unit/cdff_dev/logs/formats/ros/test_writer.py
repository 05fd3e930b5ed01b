# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Values are equal after they are written to a bag or an MCAP file and read again."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cdff_common import types
from cdff_common.errors import InputError
from cdff_common.geometry import UncertainTransform
from cdff_dev.logs import open_log
from cdff_dev.logs.differences import ROUNDING, differing_fields
from cdff_dev.logs.formats.ros.writer import create_ros_log
from cdff_dev.logs.mapping import LogMap, StreamTarget, topic_map
from cdff_dev.logs.sinks import FOXGLOVE, FOXGLOVE_JSON, ROS2
from cdff_dev.logs.source import StreamInfo

STAMP_NS = 1_600_000_000_000_000_000
K = np.array([[300.5, 0.0, 16.25], [0.0, 301.25, 12.5], [0.0, 0.0, 1.0]])
TARGETS = (
    ("run.bag", ROS2),
    ("run.mcap", ROS2),
    ("run", ROS2),
    ("fox.mcap", FOXGLOVE),
    ("json.mcap", FOXGLOVE_JSON),
)
_RNG = np.random.default_rng(1)
PIXELS = _RNG.integers(0, 255, (24, 32), np.uint8)
COLOURS = _RNG.integers(0, 255, (24, 32, 3), np.uint8)
POSE = UncertainTransform(np.diag([1.0, -1.0, -1.0, 1.0]), np.diag([0.1, 0.2, 0.3, 0.01, 0.02, 0.03]))


def scan(**columns: Any) -> types.LidarScan:
    points = _RNG.normal(size=(50, 3)).astype(np.float32)
    offsets = np.arange(50) * 1000
    return types.LidarScan.from_arrays(
        points, offsets, frame="mana/lidar", t0_ns=STAMP_NS, t1_ns=STAMP_NS + 49_000_000, **columns
    )


def depth(unit_m: float) -> types.DistanceImage:
    data = _RNG.integers(0, 4000, 24 * 32) * unit_m
    return types.DistanceImage(types.Time.from_ns(STAMP_NS), 32, 24, 1 / 300, 1 / 301, -0.05, -0.04, data)


def frame(image: np.ndarray[Any, Any], **fields: Any) -> types.Frame:
    return types.Frame.from_image(image, stamp_ns=STAMP_NS, sensor="mana/camera", **fields)


def pair() -> types.FramePair:
    return types.FramePair.from_images(
        PIXELS,
        PIXELS[::-1],
        baseline_m=0.12,
        camera_matrix=K,
        stamp_ns=STAMP_NS,
        sensor="mana/navcam_left",
        T_robot_sensor=UncertainTransform.exact(POSE.matrix),
    )


def pose(T: UncertainTransform) -> types.TransformWithCovariance:
    return types.TransformWithCovariance.from_transform(
        T, parent="mana/Odom", child="mana/base", stamp_ns=STAMP_NS, producer="mana"
    )


VALUES: dict[str, Callable[[], Any]] = {
    "/mana/lidar.scan": lambda: scan(
        intensity=np.arange(50, dtype=np.uint16) * 1300, ring=np.arange(50, dtype=np.uint16)
    ),
    "/mana/bare.scan": scan,
    "/mana/navcam.pair": pair,
    "/mana/grey.frame": lambda: frame(PIXELS, camera_matrix=K),
    "/mana/raw.frame": lambda: frame(PIXELS, camera_matrix=K, dist_coeffs=(0.1, -0.2, 0.001, 0.002)),
    "/mana/bgr.frame": lambda: frame(COLOURS, mode="BGR"),
    "/mana/rgb.frame": lambda: frame(COLOURS, mode="RGB"),
    "/mana/deep.frame": lambda: frame(PIXELS.astype(np.uint16) * 257),
    "/mana/hsv.frame": lambda: frame(COLOURS, mode="HSV"),
    "/mana/tof.depth": lambda: depth(0.001),
    "/mana/binary.depth": lambda: depth(0.25),
    "/mana/imu.imu": lambda: types.IMUSensors(
        types.Time.from_ns(STAMP_NS), np.array([0.1, 0.2, 9.8]), np.array([0.3, 0.1, 0.2]), np.zeros(3)
    ),
    "/mana/arm.joints": lambda: types.Joints(
        types.Time.from_ns(STAMP_NS),
        ("mana", "elbow"),
        tuple(types.JointState(q, 0.1, 2.0, np.nan, np.nan) for q in (0.5, -0.5)),
    ),
    "/mana/odometry.pose": lambda: pose(POSE),
    "/mana/truth.pose": lambda: pose(UncertainTransform(POSE.matrix)),
    "/mana/arm.state": lambda: types.RigidBodyState(types.Time.from_ns(STAMP_NS), "a", "b"),
    "/mana/cloud.cloud": types.Pointcloud,
}


@pytest.mark.parametrize(("target", "schemas"), TARGETS)
def test_every_value_is_read_as_it_was_written(target: str, schemas: str, tmp_path: Path) -> None:
    values = {stream: make() for stream, make in VALUES.items()}
    infos = {s: StreamInfo(type(v).ASN1_NAME, 1, STAMP_NS, STAMP_NS) for s, v in values.items()}
    with create_ros_log(tmp_path / target, topic_map(infos), schemas=schemas) as writer:
        for stream, value in values.items():
            writer.write(stream, value, STAMP_NS)
    assert writer.losses == {}
    bitstreams = {"/mana/hsv.frame", "/mana/arm.state", "/mana/cloud.cloud"}
    others = set() if schemas == ROS2 else {"/mana/imu.imu"}
    assert {stream for stream, _, _ in writer.substitutes} == bitstreams | others
    with open_log(tmp_path / target) as log:
        samples = {sample.stream: sample for sample in log.samples()}
        assert log.unconverted == {}
    assert set(samples) == set(values)
    for stream, value in values.items():
        assert samples[stream].stamp_ns == STAMP_NS
        assert differing_fields(value, samples[stream].value, ROUNDING) == [], stream


@pytest.mark.parametrize("target", ["run.bag", "run.mcap"])
def test_a_log_that_ends_early_has_the_original_names(target: str, tmp_path: Path) -> None:
    values = {stream: make() for stream, make in VALUES.items()}
    infos = {s: StreamInfo(type(v).ASN1_NAME, 1, STAMP_NS, STAMP_NS) for s, v in values.items()}
    with create_ros_log(tmp_path / target, topic_map(infos)) as writer:
        for k in range(150):
            for stream, value in values.items():
                writer.write(stream, value, STAMP_NS + k * 1_000_000)
    data = (tmp_path / target).read_bytes()
    (tmp_path / target).write_bytes(data[: len(data) // 2])
    with open_log(tmp_path / target) as log:
        assert {name: info.type_name for name, info in log.streams.items()} == {
            name: info.type_name for name, info in infos.items()
        }
        assert 60 < log.streams["/mana/imu.imu"].count < 90


def test_messages_in_json_follow_their_schemas(tmp_path: Path) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    from mcap.reader import make_reader

    values = {stream: make() for stream, make in VALUES.items()}
    infos = {s: StreamInfo(type(v).ASN1_NAME, 1, STAMP_NS, STAMP_NS) for s, v in values.items()}
    with create_ros_log(tmp_path / "run.mcap", topic_map(infos), schemas=FOXGLOVE_JSON) as writer:
        for stream, value in values.items():
            writer.write(stream, value, STAMP_NS)
    names = set()
    with (tmp_path / "run.mcap").open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                assert schema is not None
                jsonschema.validate(json.loads(message.data), json.loads(schema.data))
                names.add(schema.name.removeprefix("foxglove."))
    assert names == {
        "PointCloud",
        "RawImage",
        "CameraCalibration",
        "Odometry",
        "JointStates",
        "FrameTransforms",
    }


def test_fields_that_a_message_does_not_have_are_counted(tmp_path: Path) -> None:
    values = types.IMUSensors(types.Time.from_ns(STAMP_NS), mag=np.array([20.0, 0.0, 40.0]))
    mapping = LogMap({"/mana/imu.imu": StreamTarget("/imu")})
    with create_ros_log(tmp_path / "run.bag", mapping) as writer:
        for k in range(3):
            writer.write("/mana/imu.imu", values, STAMP_NS + k * 1000)
    assert writer.losses == {("/mana/imu.imu", "mag"): 3, ("/mana/imu.imu", "timestamp.microseconds"): 2}


def test_the_map_chooses_message_and_frames(tmp_path: Path) -> None:
    mapping = LogMap(
        {"/mana/odometry.pose": StreamTarget("/pose", "geometry_msgs/msg/PoseStamped")},
        {"mana/Odom": "map"},
    )
    with create_ros_log(tmp_path / "run.mcap", mapping) as writer:
        writer.write("/mana/odometry.pose", pose(POSE), STAMP_NS)
    assert ("/mana/odometry.pose", "data.cov") in writer.losses
    from rosbags.highlevel import AnyReader

    with AnyReader([tmp_path / "run.mcap"]) as reader:
        kinds = {c.topic: c.msgtype for c in reader.connections}
        connection = next(c for c in reader.connections if c.topic == "/pose")
        _, _, raw = next(reader.messages([connection]))
        assert reader.deserialize(raw, connection.msgtype).header.frame_id == "map"
    assert kinds["/pose"] == "geometry_msgs/msg/PoseStamped"
    with open_log(tmp_path / "run.mcap") as log:
        assert next(log.samples()).value.parent_frame == "mana/Odom"
    other = LogMap({"/mana/odometry.pose": StreamTarget("/pose", "sensor_msgs/msg/Imu")})
    with (
        pytest.raises(InputError, match="message sensor_msgs/msg/Imu for a TransformWithCovariance"),
        create_ros_log(tmp_path / "other.bag", other) as writer,
    ):
        writer.write("/mana/odometry.pose", pose(POSE), STAMP_NS)
    assert [file.name for file in tmp_path.iterdir()] == ["run.mcap"]


def test_a_folder_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    with pytest.raises(InputError, match="exists already"):
        create_ros_log(tmp_path / "run", LogMap())


@pytest.mark.parametrize("name", ["a#b", "a?b", "a%20b"])
def test_a_path_that_rosbags_would_write_elsewhere_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match="cannot be in the path of a new ROS 2 bag"):
        create_ros_log(tmp_path / name, LogMap({}))
    assert list(tmp_path.iterdir()) == []

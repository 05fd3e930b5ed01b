# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""MCAP files with messages of ROS 1 and of Foxglove's schemas, whole or damaged."""

from __future__ import annotations

import base64
import json
import logging
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from mcap.writer import CompressionType, Writer

from cdff_common.errors import CodecError
from cdff_dev.logs import open_log
from cdff_dev.logs.formats.ros.foxglove_protobuf import schema_bytes
from cdff_dev.logs.formats.ros.foxglove_types import SCHEMAS
from tests.unit.cdff_dev.logs.formats.ros.test_log import PERIOD_NS, ROS1, START_NS, imu

messages = pytest.importorskip("foxglove.messages")
POINTS_M = np.array([[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]], np.float32)
IMAGE = np.arange(64 * 48, dtype=np.uint8).reshape(48, 64)
FOCAL_PX, BASELINE_M = 60.0, 0.2


def stamp(k: int) -> tuple[int, int]:
    return divmod(START_NS + k * PERIOD_NS, 1_000_000_000)


def protobuf_messages(k: int) -> list[tuple[str, Any]]:
    """The messages of a lidar, a stereo camera and a frame tree at one time."""
    time = messages.Timestamp(*stamp(k))
    F32 = messages.PackedElementFieldNumericType.Float32
    pose = messages.Pose(
        position=messages.Vector3(x=0.0, y=0.0, z=1.0), orientation=messages.Quaternion(x=0, y=0, z=0, w=1)
    )
    cloud = messages.PointCloud(
        timestamp=time,
        frame_id="lidar",
        pose=pose,
        point_stride=12,
        fields=[
            messages.PackedElementField(name=n, offset=4 * i, type=F32) for i, n in enumerate(("x", "y", "z"))
        ],
        data=POINTS_M.tobytes(),
    )
    transform = messages.FrameTransform(
        timestamp=time,
        parent_frame_id="odom",
        child_frame_id="base",
        translation=messages.Vector3(x=1.0 * k, y=0.0, z=0.0),
        rotation=messages.Quaternion(x=0, y=0, z=0, w=1),
    )
    topic_messages = [("/lidar/points", cloud), ("/tf", transform)]
    for side, offset in (("left", 0.0), ("right", -FOCAL_PX * BASELINE_M)):
        K = [FOCAL_PX, 0.0, 32.0, 0.0, FOCAL_PX, 24.0, 0.0, 0.0, 1.0]
        P = [FOCAL_PX, 0.0, 32.0, offset, 0.0, FOCAL_PX, 24.0, 0.0, 0.0, 0.0, 1.0, 0.0]
        camera = messages.CameraCalibration(
            timestamp=time, frame_id=side, width=64, height=48, K=K, P=P, R=list(np.eye(3).ravel())
        )
        image = messages.CompressedImage(
            timestamp=time, frame_id=side, format="png", data=cv2.imencode(".png", IMAGE)[1].tobytes()
        )
        topic_messages += [(f"/{side}/camera_info", camera), (f"/{side}/image_rect", image)]
    return topic_messages


def write_mcap(
    path: Path,
    content: list[tuple[str, str, str, str, bytes, bytes, int]],
    compression: CompressionType = CompressionType.ZSTD,
    chunk_size: int = 2000,
) -> Path:
    """Write messages: topic, message encoding, schema encoding, name, schema, bytes, time of recording."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=chunk_size, compression=compression)
        writer.start()
        channels: dict[str, int] = {}
        for topic, encoding, schema_encoding, name, schema, raw, recorded_ns in content:
            if topic not in channels:
                number = writer.register_schema(name, schema_encoding, schema)
                channels[topic] = writer.register_channel(topic, encoding, number)
            writer.add_message(channels[topic], recorded_ns, raw, recorded_ns)
        writer.finish()
    return path


def protobuf_content(count: int = 3) -> list[tuple[str, str, str, str, bytes, bytes, int]]:
    content = []
    for k in range(count):
        for topic, message in protobuf_messages(k):
            schema = type(message).get_schema()
            time_ns = START_NS + k * PERIOD_NS + 5_000_000
            content.append(
                (topic, "protobuf", "protobuf", schema.name, schema.data, message.encode(), time_ns)
            )
    return content


@pytest.fixture(params=[CompressionType.NONE, CompressionType.LZ4, CompressionType.ZSTD])
def drive(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    return write_mcap(tmp_path / "rover.mcap", protobuf_content(), request.param)


def test_protobuf_messages_of_foxglove_are_converted_with_their_stamps(drive: Path) -> None:
    with open_log(drive) as log:
        assert {name: info.count for name, info in log.streams.items()} == {
            "/rover/lidar_points.scan": 3,
            "/rover/stereo.pair": 3,
            "/rover/tf.base": 3,
        }
        samples = list(log.samples())
    assert [s.stamp_ns for s in samples[::3]] == [START_NS + k * PERIOD_NS for k in range(3)]
    scan = next(s.value for s in samples if s.type_name == "LidarScan")
    np.testing.assert_allclose(scan.points_m, np.add(POINTS_M, [0.0, 0.0, 1.0]))
    assert scan.frame == "rover/lidar"
    pair = next(s.value for s in samples if s.type_name == "FramePair")
    assert pair.baseline == pytest.approx(BASELINE_M)
    np.testing.assert_array_equal(pair.left.image, IMAGE)
    poses = [s.value for s in samples if s.stream == "/rover/tf.base"]
    assert [pose.transform.matrix[0, 3] for pose in poses] == [0.0, 1.0, 2.0]


def test_messages_of_ros_1_are_decoded(tmp_path: Path) -> None:
    kind = "sensor_msgs/msg/Imu"
    definition = ROS1.generate_msgdef(kind)[0].encode()
    raw = bytes(ROS1.serialize_ros1(imu(ROS1, START_NS), kind))
    content = [("/imu/data", "ros1", "ros1msg", "sensor_msgs/Imu", definition, raw, START_NS)]
    with open_log(write_mcap(tmp_path / "rover.mcap", content)) as log:
        sample = next(log.samples(["/rover/imu_data.imu"]))
    np.testing.assert_allclose(sample.value.gyro, [0.1, 0.2, 0.3])
    assert sample.stamp_ns == START_NS


def json_message(kind: str, **fields: Any) -> tuple[str, bytes]:
    sec, nsec = stamp(0)
    return f"foxglove.{kind}", json.dumps({"timestamp": {"sec": sec, "nsec": nsec}, **fields}).encode()


def test_json_messages_of_foxglove_are_converted(tmp_path: Path) -> None:
    pose = {"position": {"x": 1.0, "y": 2.0, "z": 3.0}, "orientation": {"x": 0, "y": 0, "z": 0, "w": 1}}
    data = base64.b64encode(IMAGE.tobytes()).decode()
    image = {"frame_id": "cam", "width": 64, "height": 48, "encoding": "mono8", "step": 64, "data": data}
    scan = {"frame_id": "laser", "pose": pose, "start_angle": 0.0, "end_angle": np.pi / 2}
    scan |= {"ranges": [1.0, 0.0, 2.0], "intensities": []}
    topics = {
        "/pose": json_message("PoseInFrame", frame_id="map", pose=pose),
        "/camera/image": json_message("RawImage", **image),
        "/laser": json_message("LaserScan", **scan),
        "/fix": json_message("LocationFix", frame_id="gps", latitude=1.0, longitude=2.0, altitude=3.0),
        "/other": ("mine.Thing", b"{}"),
    }
    content = [(t, "json", "jsonschema", name, b"{}", raw, START_NS) for t, (name, raw) in topics.items()]
    with open_log(write_mcap(tmp_path / "rover.mcap", content)) as log:
        values = {s.stream: s.value for s in log.samples()}
        assert {name: item.type_name for name, item in log.unconverted.items()} == {
            "messages of /fix without a covariance": "foxglove.LocationFix",
            "/other": "mine.Thing",
        }
    np.testing.assert_allclose(values["/rover/pose.pose"].transform.matrix[:3, 3], [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(values["/rover/camera_image.frame"].image, IMAGE)
    np.testing.assert_allclose(
        values["/rover/laser.scan"].points_m, [[2.0, 2.0, 3.0], [1.0, 4.0, 3.0]], atol=1e-6
    )


def test_locations_in_protobuf_are_positions(tmp_path: Path) -> None:
    location = messages.LocationFix(
        timestamp=messages.Timestamp(*stamp(2)),
        frame_id="gps",
        latitude=1.0,
        longitude=2.0,
        altitude=3.0,
        position_covariance=list(np.diag([4.0, 5.0, 6.0]).ravel()),
        position_covariance_type=messages.LocationFixPositionCovarianceType.DiagonalKnown,
    )
    schema = messages.LocationFix.get_schema()
    content = [("/fix", "protobuf", "protobuf", schema.name, schema.data, location.encode(), START_NS)]
    with open_log(write_mcap(tmp_path / "rover.mcap", content)) as log:
        assert log.unconverted == {}
        (sample,) = log.samples(["/rover/fix.fix"])
    assert sample.stamp_ns == START_NS + 2 * PERIOD_NS
    np.testing.assert_allclose(np.diag(sample.value.transform.covariance)[:3], [4.0, 5.0, 6.0])
    assert sample.value.child_frame == "rover/gps"


def test_channels_that_cannot_be_decoded_are_named_with_the_reason(tmp_path: Path) -> None:
    content = [
        ("/a", "cbor", "cddl", "x.Y", b"", b"", START_NS),
        ("/b", "protobuf", "protobuf", "x.Y", b"\xff\xff", b"", START_NS),
        ("/c", "ros1", "ros1msg", "std_msgs/String'; import os", b"string data", b"", START_NS),
        ("/d", "cdr", "ros2msg", "x/msg/Self", b"x/Self inner", b"\0\1\0\0", START_NS),
    ]
    with open_log(write_mcap(tmp_path / "rover.mcap", content)) as log:
        assert not log.streams
        reasons = {name: item.reason for name, item in log.unconverted.items()}
    assert "'cbor'" in reasons["/a"]
    assert "schema" in reasons["/b"]
    assert "expected the name of a type" in reasons["/c"]
    assert len(reasons) == 4


@pytest.mark.parametrize("fraction", [0.3, 0.6, 0.9])
def test_a_file_that_ends_early_is_read_up_to_its_end(
    tmp_path: Path, fraction: float, caplog: pytest.LogCaptureFixture
) -> None:
    whole_file = write_mcap(tmp_path / "rover.mcap", protobuf_content(20), CompressionType.LZ4, 800)
    with open_log(whole_file) as log:
        count = log.streams["/rover/tf.base"].count
    data = whole_file.read_bytes()
    whole_file.write_bytes(data[: int(len(data) * fraction)])
    caplog.set_level(logging.WARNING, "cdff_dev.logs")
    with open_log(whole_file) as log:
        assert 0 < log.streams["/rover/tf.base"].count <= count
        assert len(list(log.samples())) == sum(info.count for info in log.streams.values())
        assert [item.type_name for item in log.unconverted.values()].count("damaged part") == 1
    assert "rover.mcap: byte" in caplog.text


def test_a_damaged_chunk_is_left_out(tmp_path: Path) -> None:
    whole_file = write_mcap(tmp_path / "rover.mcap", protobuf_content(20), CompressionType.LZ4, 800)
    with open_log(whole_file) as log:
        count = sum(info.count for info in log.streams.values())
    data = bytearray(whole_file.read_bytes())
    at = data.index(b"lz4") + 200
    data[at : at + 4] = b"\xff\xff\xff\xff"
    whole_file.write_bytes(data)
    with open_log(whole_file) as log:
        assert count - 5 < sum(info.count for info in log.streams.values()) < count
        assert any(name.startswith("byte") for name in log.unconverted)


def test_other_files_called_mcap_are_refused(tmp_path: Path) -> None:
    (tmp_path / "x.mcap").write_bytes(b"\x89MCAP9\r\n")
    with pytest.raises(Exception, match=r"x\.mcap") as caught:
        open_log(tmp_path / "x.mcap")
    assert not isinstance(caught.value, CodecError) or "byte 0" in str(caught.value)


def test_the_shared_recording_has_its_topics(real_data: Callable[[str], Path]) -> None:
    with open_log(real_data("rosbags") / "nav2_turtlebot.mcap") as log:
        assert log.streams["/nav2_turtlebot/odom.pose"].count == 2639
        assert len(log.streams) == 35


@pytest.mark.parametrize("name", sorted({name for name, _ in SCHEMAS.values()}))
def test_written_schemas_are_those_of_the_sdk(name: str) -> None:
    def fields(data: bytes) -> dict[str, dict[str, tuple[Any, ...]]]:
        files = FileDescriptorSet.FromString(data).file
        return {
            message.name: {
                f.name: (f.number, f.type, f.label, f.type_name, f.proto3_optional) for f in message.field
            }
            for file in files
            for message in file.message_type
        }

    own, reference = fields(schema_bytes()), fields(getattr(messages, name).get_schema().data)
    assert all(own[name][key] == reference[name][key] for key in own[name])
    for part in own.keys() & reference.keys():
        assert all(own[part][key] == reference[part][key] for key in own[part]), part


def test_joints_without_a_value_are_not_zero(tmp_path: Path) -> None:
    states = messages.JointStates(
        timestamp=messages.Timestamp(*stamp(0)), joints=[messages.JointState(name="elbow", position=0.5)]
    )
    schema = type(states).get_schema()
    content = [("/joints", "protobuf", "protobuf", schema.name, schema.data, states.encode(), START_NS)]
    with open_log(write_mcap(tmp_path / "rover.mcap", content)) as log:
        (sample,) = log.samples()
    (state,) = sample.value.elements
    assert state.position == 0.5
    assert np.isnan([state.speed, state.effort]).all()

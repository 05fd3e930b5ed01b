# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Every entry of the table of messages: values are equal after the message and its bytes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cdff_common import types as cdff
from cdff_common.codecs.bitstream import unwrap
from cdff_common.errors import InputError
from cdff_common.geodesy import Anchor, body
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.raster.geometry import GridGeometry
from services.ros_messages.conversions import CAMERA_INFO, CONVERSIONS, transforms
from services.ros_messages.encoders import bitstream, transform_message
from services.ros_messages.encoding import Target
from services.ros_messages.fixes import LocalFrame
from services.ros_messages.mapping import TABLE, MessageMapping, function, mapping_table
from services.ros_messages.message_types import RosTypes
from services.ros_messages.topics import Topic
from tests.support.messages import ALL, random_message

_NS = 1_600_000_000_000_000_000
_TYPES = {version: RosTypes(version) for version in (1, 2)}
_FRAMES = {name: f"mana/{name}" for name in ("sensor", "odom", "base_link", "enu", "rock")}
_LOCAL = LocalFrame("enu", Anchor(body("earth"), 1.5, 43.5, 150.0))
_WRITTEN = [e for e in mapping_table().messages if e.write and e.type != "Asn1Bitstream"]
Rng = np.random.Generator


def _matrix(rng: Rng) -> Any:
    q = rng.normal(size=4)
    return se3.transform_from_quaternion_xyzw(rng.normal(size=3), q / np.linalg.norm(q))


def _covariance(rng: Rng) -> Any:
    A = rng.normal(size=(6, 6))
    return A @ A.T


def _pose(rng: Rng) -> cdff.TransformWithCovariance:
    T = _matrix(rng)
    covariance = _covariance(rng) if rng.random() < 0.7 else None
    return cdff.TransformWithCovariance.from_transform(
        UncertainTransform(T, covariance),
        parent="mana/odom",
        child="mana/base_link",
        stamp_ns=_NS,
        producer="mana",
    )


def _imu(rng: Rng) -> Any:
    return cdff.IMUSensors(cdff.Time.from_ns(_NS), rng.normal(size=3), rng.normal(size=3), np.zeros(3))


def _joints(rng: Rng) -> Any:
    count = int(rng.integers(4))
    states = tuple(cdff.JointState(*rng.normal(size=3), np.nan, np.nan) for _ in range(count))
    return cdff.Joints(cdff.Time.from_ns(_NS), tuple(f"joint_{i}" for i in range(count)), states)


def _lidar(rng: Rng) -> Any:
    count = int(rng.integers(1, 30))
    offsets = np.sort(rng.integers(0, 100_000, count)).astype(np.uint32)
    offsets[0] = 0
    return cdff.LidarScan.from_arrays(
        rng.normal(size=(count, 3)).astype(np.float32),
        offsets,
        frame="mana/sensor",
        t0_ns=_NS,
        t1_ns=_NS + int(offsets[-1]) * 1000,
        intensity=rng.integers(0, 65536, count).astype(np.uint16) if rng.random() < 0.5 else None,
        ring=rng.integers(0, 64, count).astype(np.uint16) if rng.random() < 0.5 else None,
    )


def _laser(rng: Rng) -> Any:
    count = int(rng.integers(2, 40))
    return cdff.LaserScan(
        cdff.Time.from_ns(_NS),
        -1.0,
        0.01,
        0.0,
        rng.integers(0, 20_000, count).astype(np.int32),
        100,
        30_000,
        rng.integers(0, 1000, count).astype(np.float64),
    )


def _image(rng: Rng) -> Any:
    mode, dtype, channels = [("GRAY", np.uint8, ()), ("GRAY", np.uint16, ()), ("BGR", np.uint8, (3,))][
        rng.integers(3)
    ]
    shape = (int(rng.integers(1, 5)), int(rng.integers(1, 7)), *channels)
    K = np.array([[300.0, 0.0, 3.0], [0.0, 310.0, 2.0], [0.0, 0.0, 1.0]])
    return cdff.Frame.from_image(
        rng.integers(0, 255, shape).astype(dtype),
        stamp_ns=_NS,
        mode=mode,
        sensor="mana/sensor",
        camera_matrix=K if rng.random() < 0.5 else None,
        dist_coeffs=(),
    )


def _pair(rng: Rng) -> Any:
    left, right = rng.integers(0, 255, (2, 3, 4)).astype(np.uint8)
    K = np.array([[300.0, 0.0, 2.0], [0.0, 300.0, 1.5], [0.0, 0.0, 1.0]])
    return cdff.FramePair.from_images(
        left, right, baseline_m=0.25, camera_matrix=K, stamp_ns=_NS, sensor="mana/sensor"
    )


def _distances(rng: Rng) -> Any:
    shape = int(rng.integers(1, 5)), int(rng.integers(1, 5))
    depths = (
        rng.integers(1, 60_000, shape) * 1e-3 if rng.random() < 0.5 else rng.random(shape).astype(np.float32)
    )
    return cdff.DistanceImage(
        cdff.Time.from_ns(_NS),
        shape[1],
        shape[0],
        0.5,
        0.25,
        -0.5,
        -0.25,
        np.ravel(depths).astype(np.float64),
    )


def _grid(shape: tuple[int, int]) -> GridGeometry:
    return GridGeometry("mana/odom", 0.5, -3.0, 4.0, *shape)


def _navigation(rng: Rng) -> Any:
    classes = rng.integers(0, 4, (3, 5)).astype(np.uint8)
    return cdff.NavigationMap.from_layers(_grid((3, 5)), {"class": classes}, t0_ns=_NS, t1_ns=_NS)


def _elevation(rng: Rng) -> Any:
    heights = rng.normal(size=(3, 5)).astype(np.float32)
    return cdff.ElevationMap.from_layers(_grid((3, 5)), {"mean": heights}, t0_ns=_NS, t1_ns=_NS)


def _twist(rng: Rng) -> Any:
    cov = _covariance(rng) if rng.random() < 0.7 else np.full((6, 6), np.nan)
    metadata = cdff.TwistWithCovarianceMetadata(time_stamp=cdff.Time.from_ns(_NS))
    data = cdff.TwistWithCovarianceData(rng.normal(size=3), rng.normal(size=3), cov)
    return cdff.TwistWithCovariance(metadata, data)


def _trajectory(rng: Rng) -> Any:
    count = int(rng.integers(1, 5))
    matrices = np.array([_matrix(rng) for _ in range(count)])
    stamps_ns = _NS - 1_000_000 * np.arange(count)[::-1]
    return cdff.PoseTrajectory.from_arrays(
        stamps_ns, matrices, parent="mana/odom", child="mana/base_link", producer="mana"
    )


def _detections(rng: Rng) -> Any:
    items = []
    for _ in range(rng.integers(3)):
        pose = cdff.TransformWithCovariance.from_transform(
            UncertainTransform(_matrix(rng), _covariance(rng)),
            parent="mana/sensor",
            child="mana/rock",
            stamp_ns=_NS,
            producer="mana",
        )
        items.append(cdff.ObjectDetection.from_pose("rock", float(rng.random()), pose, size_m=rng.random(3)))
    return cdff.ObjectDetections(
        time_stamp=cdff.Time.from_ns(_NS), producer_id="mana", frame_id="mana/sensor", detections=tuple(items)
    )


def _event(rng: Rng) -> Any:
    import msgpack

    state = {"level": int(rng.integers(4)), "name": "battery", "message": "é", "hardware_id": "7"}
    body = {"frame": "base", "status": [{**state, "values": [["volts", str(rng.random())]]}]}
    return cdff.Event(
        time_stamp=cdff.Time.from_ns(_NS),
        scope="mana",
        kind="diagnostics",
        body=np.frombuffer(msgpack.packb(body), np.uint8),
    )


def _fix(rng: Rng) -> Any:
    covariance = np.diag([1.0, 2.0, 4.0, *[np.pi**2] * 3])
    T = UncertainTransform(se3.transform(np.eye(3), np.round(100.0 * rng.normal(size=3), 7)), covariance)
    value = cdff.TransformWithCovariance.from_transform(
        T, parent="mana/enu", child="mana/sensor", stamp_ns=_NS, producer="mana"
    )
    is_estimated = np.array([True] * 3 + [False] * 4)
    return replace(value, metadata=replace(value.metadata, data_estimated=is_estimated))


_VALUES: dict[str, Callable[[Rng], Any]] = {
    "IMUSensors": _imu,
    "TransformWithCovariance": _pose,
    "Joints": _joints,
    "LidarScan": _lidar,
    "LaserScan": _laser,
    "Frame": _image,
    "FramePair": _pair,
    "DistanceImage": _distances,
    "NavigationMap": _navigation,
    "ElevationMap": _elevation,
    "TwistWithCovariance": _twist,
    "PoseTrajectory": _trajectory,
    "ObjectDetections": _detections,
    "Event": _event,
    "DFPC-Status": lambda rng: cdff.DfpcStatus(
        robot="mana", dfpc="lidar_slam", state=cdff.DfpcStateT.DFPC_ACTIVE, dropped=int(rng.integers(2))
    ),
    "Time": lambda rng: cdff.Time(int(rng.integers(2**50))),
}
#: Fields that a message cannot express, as the reader states them.
_UNKNOWN = np.full((6, 6), np.nan)


def _expected(entry: MessageMapping, value: Any) -> Any:
    """Return the value without the fields that the table lists as not written."""
    if "data.cov" in entry.not_written:
        return replace(value, data=replace(value.data, cov=_UNKNOWN))
    return value


def _through_bytes(message: Any, name: str, version: int) -> Any:
    types = _TYPES[version]
    return types.deserialize(bytes(types.serialize(message, name)), name)


def _target() -> Target:
    names = {frame: frame_id for frame_id, frame in _FRAMES.items()}
    return Target("/topic", "mana", "mana/sensor", names.__getitem__, _FRAMES, {}, _LOCAL)


@pytest.mark.parametrize("entry", _WRITTEN, ids=lambda e: f"{e.type}-{e.message.rpartition('/')[2]}")
@settings(max_examples=8, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_a_value_is_equal_after_its_messages_and_their_bytes(entry: MessageMapping, seed: int) -> None:
    value = (_fix if entry.message.endswith("NavSatFix") else _VALUES[entry.type])(
        np.random.default_rng(seed)
    )
    for version in entry.versions:
        encoded = function(entry.write)(value, _target(), _TYPES[version], _NS)
        out = encoded.messages[0]
        assert out.type_name == entry.message
        message = _through_bytes(out.message, out.type_name, version)
        infos = [
            _through_bytes(m.message, CAMERA_INFO, version)
            for m in encoded.messages
            if m.type_name == CAMERA_INFO
        ]
        topic = Topic(out.topic, "mana", CONVERSIONS[entry.message], next(iter(infos), None), _LOCAL)
        convert = CONVERSIONS[entry.message].convert if entry.read is None else function(entry.read)
        back, *_ = convert(message, topic, _NS)
        if entry.read is None:
            _check_one_way(value, back, entry.type)
        elif entry.message.endswith("NavSatFix"):
            np.testing.assert_allclose(back.data.translation, value.data.translation, atol=1e-7)
            np.testing.assert_allclose(back.data.cov, value.data.cov, atol=1e-9)
            assert back.metadata == value.metadata
        else:
            _check_equal(back, _expected(entry, value))


def _check_equal(back: Any, expected: Any) -> None:
    """Poses of matrices have quaternions that are normalised again; all else is equal."""
    if isinstance(expected, cdff.TransformWithCovariance):
        assert back.metadata == expected.metadata
        np.testing.assert_allclose(back.transform.matrix, expected.transform.matrix, atol=1e-14)
        np.testing.assert_array_equal(back.data.cov, expected.data.cov)
    elif isinstance(expected, cdff.PoseTrajectory):
        assert back.metadata == expected.metadata
        np.testing.assert_array_equal(back.stamps_ns, expected.stamps_ns)
        np.testing.assert_allclose(back.matrices, expected.matrices, atol=1e-14)
    elif isinstance(expected, cdff.ObjectDetections):
        assert (back.frame_id, len(back.detections)) == (expected.frame_id, len(expected.detections))
        for item, wanted in zip(back.detections, expected.detections, strict=True):
            assert (item.label, item.score) == (wanted.label, wanted.score)
            np.testing.assert_array_equal(item.size, wanted.size)
            _check_equal(item.pose, wanted.pose)
    elif isinstance(expected, cdff.DistanceImage):
        assert (back.width, back.height) == (expected.width, expected.height)
        np.testing.assert_allclose(back.data, expected.data, rtol=1e-12)
        for name in ("scale_x", "scale_y", "center_x", "center_y"):
            assert getattr(back, name) == pytest.approx(getattr(expected, name))
    elif isinstance(expected, cdff.NavigationMap | cdff.ElevationMap):
        assert back.geometry == expected.geometry
        for name in expected.layer_names:
            np.testing.assert_array_equal(back.layer(name), expected.layer(name))
    else:
        assert back == expected


def _check_one_way(value: Any, back: Any, type_name: str) -> None:
    """Types whose message is read as another type: its content is that of the value."""
    if type_name == "LaserScan":
        ranges_m = value.ranges * 1e-3
        valid = (value.ranges >= 5) & (ranges_m >= 0.1) & (ranges_m <= 30.0)
        # The limit of 32 bits is not exactly 0.1 m.
        np.testing.assert_allclose(np.linalg.norm(back.points_m, axis=1), ranges_m[valid], rtol=1e-6)
        angles = value.start_angle + value.angular_resolution * np.flatnonzero(valid)
        np.testing.assert_allclose(np.arctan2(back.points_m[:, 1], back.points_m[:, 0]), angles, atol=1e-5)
    elif type_name == "FramePair":
        np.testing.assert_array_equal(back.image, value.left.image)
    else:
        assert type_name == "DFPC-Status"
        assert back.kind == "diagnostics"
        level = b"\xa5level" + bytes([1 if value.dropped else 0])
        assert level in back.body.tobytes()


@pytest.mark.parametrize("name", ALL)
def test_every_type_is_equal_after_a_bitstream(name: str, rng: np.random.Generator) -> None:
    value = random_message(name, rng)
    for version, types in _TYPES.items():
        (out,) = bitstream(value, _target(), types, _NS).messages
        back = _through_bytes(out.message, out.type_name, version)
        wrapped, *_ = function("conversions.bitstream")(
            back, Topic("/bits", "mana", CONVERSIONS[out.type_name]), _NS
        )
        assert unwrap(wrapped) == value


@pytest.mark.parametrize("version", [1, 2])
def test_a_frame_tree_has_the_transforms_of_its_poses(version: int, rng: np.random.Generator) -> None:
    poses = [_pose(rng) for _ in range(3)]
    tree = [transform_message(pose, _target(), _TYPES[version], _NS) for pose in poses]
    message = _TYPES[version].make("tf2_msgs/TFMessage", transforms=tree)
    topic = Topic("/tf", "mana", CONVERSIONS["tf2_msgs/msg/TFMessage"])
    read = transforms(_through_bytes(message, "tf2_msgs/msg/TFMessage", version))
    for pose, transform in zip(poses, read, strict=True):
        back, *_ = topic.conversion.convert(transform, topic, _NS)
        np.testing.assert_allclose(back.transform.matrix, pose.transform.matrix, atol=1e-14)


def test_all_functions_and_types_of_the_table_exist() -> None:
    known = {getattr(cdff, name).ASN1_NAME for name in dir(cdff) if hasattr(getattr(cdff, name), "ASN1_NAME")}
    for entry in mapping_table().messages:
        assert entry.type in known, entry
        for name in (entry.read, entry.write, entry.split):
            assert name is None or callable(function(name))
        assert entry.read or entry.write
        for version in entry.versions:
            assert entry.message in _TYPES[version].store.types or entry.message == "tf/msg/tfMessage"
    assert TABLE.is_file()


def test_a_path_without_times_and_detections_of_ros_1_are_refused(rng: np.random.Generator) -> None:
    (out,) = function("product_encoders.path")(
        _trajectory(np.random.default_rng(3)), _target(), _TYPES[2], _NS
    ).messages
    out.message.poses[1].header.stamp = out.message.poses[0].header.stamp
    topic = Topic("/path", "mana", CONVERSIONS[out.type_name])
    with pytest.raises(InputError, match="do not ascend"):
        topic.conversion.convert(out.message, topic, _NS)
    with pytest.raises(InputError, match="ROS 1"):
        function("product_encoders.detections")(_detections(rng), _target(), _TYPES[1], _NS)

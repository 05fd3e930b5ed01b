# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Stereo cameras and satellite navigation of a robot: pairs, rectification, positions and their faults."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.types import FramePair, TransformWithCovariance
from services.gateways.frames import FrameNames, FrameTree
from services.gateways.inputs import InputLink
from services.gateways.settings import GatewaySettings, InputTopic
from services.gateways.stereo_inputs import StereoLink
from services.ros_messages.encoders import fix
from services.ros_messages.encoding import Target
from services.ros_messages.image_encoders import CAMERA_INFO, IMAGE, pair_images
from services.ros_messages.message_types import RosTypes
from tests.unit.services.gateways.test_damaged_messages import Samples

_NS = 1_600_000_000_000_000_000
_STEREO = {
    "topic": "/nav/left/image_rect",
    "right": "/nav/right/image_rect",
    "type": IMAGE,
    "stream": "nav/pair",
    "frame": "mana/cam",
    "camera_info": "/nav/left/camera_info",
    "right_camera_info": "/nav/right/camera_info",
}


class Robot:
    """Link of a stereo camera, and the messages of its four topics."""

    def __init__(self, version: int, **changes: str) -> None:
        self.types = RosTypes(version)
        entry = InputTopic.model_validate(_STEREO | changes)
        bus: Any = None
        self.link = StereoLink(entry, FrameNames("mana"), self.types, bus, FrameTree())
        self.receive = {entry.topic: self.link.on_message}
        self.receive |= {further.topic: further.receive for further in self.link.further_topics}

    def messages(self, seq: int, stamp_ns: int) -> tuple[FramePair, dict[str, Any]]:
        images = np.random.default_rng(seq).integers(0, 255, (2, 30, 40)).astype(np.uint8)
        K = np.array([[40.0, 0.0, 20.0], [0.0, 40.0, 15.0], [0.0, 0.0, 1.0]])
        pair = FramePair.from_images(
            *images, baseline_m=0.25, camera_matrix=K, stamp_ns=stamp_ns, sensor="mana/cam"
        )
        target = Target("/nav", "mana", "mana/cam", lambda f: f.removeprefix("mana/"), {}, {})
        out = pair_images(pair, target, self.types, stamp_ns).messages
        return pair, {o.topic: o.message for o in out}

    def send(self, topic: str, message: Any) -> None:
        type_name = CAMERA_INFO if topic.endswith("camera_info") else IMAGE
        self.receive[topic](bytes(self.types.serialize(message, type_name)))

    @property
    def pairs(self) -> list[Any]:
        samples: Any = self.link.sensor
        return list(samples.values)

    @property
    def dropped(self) -> dict[str, int]:
        counts: dict[str, int] = self.link.counters.to_map()["dropped"]
        return counts


@pytest.fixture(autouse=True)
def _without_a_bus(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("services.gateways.sample_link.Sensor", Samples)


@pytest.mark.parametrize("version", [1, 2])
def test_images_of_one_time_are_pairs_in_either_order(version: int) -> None:
    robot = Robot(version)
    for seq in range(4):
        expected, messages = robot.messages(seq, _NS + seq * 100_000_000)
        order = sorted(messages, reverse=bool(seq % 2))
        for topic in sorted(order, key=lambda name: "image" in name):
            robot.send(topic, messages[topic])
        pair = robot.pairs[-1]
        assert len(robot.pairs) == seq + 1
        assert pair.stamp_ns == expected.stamp_ns
        assert pair.baseline == pytest.approx(0.25)
        np.testing.assert_array_equal(pair.left.image, expected.left.image)
        np.testing.assert_array_equal(pair.right.image, expected.right.image)
        np.testing.assert_allclose(pair.left.camera_matrix, expected.left.camera_matrix)
    assert robot.dropped == {}


def test_images_without_a_partner_and_without_a_calibration_are_counted() -> None:
    robot = Robot(2)
    _, messages = robot.messages(0, _NS)
    left, right = (f"/nav/{side}/image_rect" for side in ("left", "right"))
    robot.send(left, messages[left])
    robot.send(right, messages[right])
    assert robot.dropped == {"content": 1}
    for topic in (t for t in messages if t.endswith("camera_info")):
        robot.send(topic, messages[topic])
    for i in range(6):  # the right camera does not send
        robot.send(left, robot.messages(i, _NS + i * 100_000_000)[1][left])
    assert robot.dropped == {"content": 1, "pair": 2}
    robot.send(right, robot.messages(5, _NS + 500_000_000)[1][right])
    assert [pair.stamp_ns for pair in robot.pairs] == [_NS + 500_000_000]
    assert robot.dropped == {"content": 1, "pair": 5}


@pytest.mark.parametrize(("difference_ms", "count"), [(4.9, 1), (-4.9, 1), (5.1, 0), (-5.1, 0)])
def test_images_up_to_5_ms_apart_are_a_pair_with_the_stamp_of_the_left_one(
    difference_ms: float, count: int
) -> None:
    robot = Robot(2)
    for topic, message in robot.messages(0, _NS)[1].items():
        if topic.endswith("camera_info"):
            robot.send(topic, message)
    for side, stamp_ns in (("left", _NS), ("right", _NS + int(difference_ms * 1e6))):
        topic = f"/nav/{side}/image_rect"
        robot.send(topic, robot.messages(0, stamp_ns)[1][topic])
    assert [pair.stamp_ns for pair in robot.pairs] == [_NS] * count
    assert robot.dropped == {}


def test_rectified_images_of_another_size_than_their_calibration_are_dropped_with_the_sizes() -> None:
    robot = Robot(2)
    messages = robot.messages(0, _NS)[1]
    for topic in sorted(messages, key=lambda name: "image" in name):
        if topic.endswith("camera_info"):
            messages[topic].height, messages[topic].width = 60, 80
        robot.send(topic, messages[topic])
    assert (robot.pairs, robot.dropped) == ([], {"content": 1})
    fault = robot.link.counters.to_map()["last_fault"]
    assert fault == "InputError: image of 30 x 40 pixels, its calibration is for 60 x 80 pixels"


def test_a_clock_that_is_set_back_does_not_end_the_pairs() -> None:
    robot = Robot(2)
    for topic, message in robot.messages(0, _NS)[1].items():
        if topic.endswith("camera_info"):
            robot.send(topic, message)
    left, right = (f"/nav/{side}/image_rect" for side in ("left", "right"))
    for i in range(4):
        robot.send(left, robot.messages(i, _NS + 3_600_000_000_000 + i * 100_000_000)[1][left])
    for i in range(3):
        messages = robot.messages(i, _NS + i * 100_000_000)[1]
        robot.send(left, messages[left])
        robot.send(right, messages[right])
    assert [pair.stamp_ns for pair in robot.pairs] == [_NS, _NS + 100_000_000, _NS + 200_000_000]


def test_images_that_are_not_rectified_are_rectified_with_their_calibrations() -> None:
    names = {"topic": "/nav/left/image_raw", "right": "/nav/right/image_raw"}
    robot = Robot(2, **names)
    _, messages = robot.messages(0, _NS)
    for topic, message in messages.items():
        if topic.endswith("camera_info"):
            message.d = np.array([-0.2, 0.05, 0.0, 0.0, 0.0])
            robot.send(topic, message)
    for side in ("left", "right"):
        robot.send(f"/nav/{side}/image_raw", messages[f"/nav/{side}/image_rect"])
    (pair,) = robot.pairs
    assert not np.array_equal(pair.left.image, messages["/nav/left/image_rect"].data.reshape(30, 40))
    assert pair.baseline == pytest.approx(0.25)


def test_positions_of_a_receiver_are_poses_in_a_located_frame() -> None:
    types = RosTypes(2)
    settings = GatewaySettings.model_validate(
        {
            "robot": "mana",
            "origins": {"site": [1.5, 43.5, 150.0]},
            "inputs": [
                {
                    "topic": "/fix",
                    "type": "sensor_msgs/msg/NavSatFix",
                    "stream": "gnss/fix",
                    "frame": "site",
                    "child": "mana/gnss",
                }
            ],
        }
    )
    names = FrameNames("mana", settings.frames, settings.origins)
    link = InputLink(settings.inputs[0], names, types, None, FrameTree())  # type: ignore[arg-type]
    message = types.make(
        "sensor_msgs/NavSatFix",
        header=types.header(_NS, "gnss"),
        status=types.make("sensor_msgs/NavSatStatus", status=0, service=1),
        latitude=43.5 + 1e-4,
        longitude=1.5,
        altitude=152.0,
        position_covariance=np.diag([4.0, 9.0, 16.0]).ravel(),
        position_covariance_type=2,
    )
    link.on_message(bytes(types.serialize(message, "sensor_msgs/msg/NavSatFix")))
    samples: Any = link.sensor
    (value,) = samples.values
    assert isinstance(value, TransformWithCovariance)
    assert (value.parent_frame, value.child_frame) == ("site", "mana/gnss")
    np.testing.assert_allclose(value.data.translation, [0.0, 11.1116, 2.0], atol=2e-3)
    np.testing.assert_allclose(np.diag(value.data.cov)[:3], [4.0, 9.0, 16.0], rtol=1e-4)
    target = Target("/out", "mana", "site", names.of_robot, {}, {}, names.local_frame("site"))
    back = fix(value, target, types, _NS).messages[0].message
    assert (back.latitude, back.longitude) == pytest.approx((43.5 + 1e-4, 1.5), abs=1e-9)
    message.status.status = -1
    link.on_message(bytes(types.serialize(message, "sensor_msgs/msg/NavSatFix")))
    counters = link.counters.to_map()
    assert counters["dropped"] == {"content": 1}
    assert counters["last_fault"] == "InputError: a position without a fix"

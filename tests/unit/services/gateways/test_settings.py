# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Settings of the gateway: topics that may pass, refused with the reason; limits of a rate."""

from __future__ import annotations

from pathlib import Path

import pytest
from pydantic import ValidationError
from rosbags.typesys import get_types_from_msg

from cdff_common.errors import ConfigurationError
from services.gateway_ros1.settings import Ros1Settings
from services.gateway_ros2.settings import Ros2Settings
from services.gateways.counters import RateLimit, TopicCounters
from services.gateways.request_types import ACTIONS, REQUEST_ACTION, REQUEST_SERVICE, SERVICES
from services.gateways.stream_settings import load_settings
from services.ros_messages.message_types import BITSTREAM, RosTypes

_IMU = "{topic: /imu/data, type: sensor_msgs/msg/Imu, stream: imu/sample, frame: mana/imu}"
_EDGE = "{topic: /tf, type: tf2_msgs/msg/TFMessage, stream: tf/STREAM, frame: mana/odom, child: mana/CHILD}"
_FIX = "{topic: /fix, type: sensor_msgs/msg/NavSatFix, stream: gnss/fix, frame: site, child: mana/gnss}"
_TWICE = _IMU.replace("imu/sample", "imu/other")


def _load(tmp_path: Path, text: str) -> Ros2Settings:
    path = tmp_path / "gateway.yaml"
    path.write_text(f"robot: mana\n{text}\n")
    return load_settings(path, Ros2Settings)


def test_without_outputs_the_gateway_only_reads(tmp_path: Path) -> None:
    settings = _load(tmp_path, f"inputs: [{_IMU}]")
    assert settings.outputs == ()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f"inputs: [{_IMU.replace('msg/Imu', 'msg/Range')}]", "expected one of .*sensor_msgs/msg/Imu"),
        (f"inputs: [{_IMU.replace('/imu/data', '/imu/*')}]", r"inputs\.0\.topic"),
        (f"inputs: [{_IMU}, {_TWICE}]", "a topic twice"),
        (f"inputs: [{_IMU}]\noutputs: [{{product: a/b, topic: /imu/data}}]", "circulate"),
        ("outputs: [{product: a/b, topic: /x, type: std_msgs/msg/Char}]", "expected one of"),
        ("frames: {a: mana/base, b: mana/base}", "two names"),
        (
            "outputs: [{product: a/b, topic: /x}, "
            "{product: a/c, topic: /x, type: geometry_msgs/msg/PoseStamped}]",
            "output topic /x has the types infuse_msgs/msg/Asn1Bitstream and geometry_msgs/msg/PoseStamped",
        ),
        (
            "outputs: [{product: a/b, topic: /x}, {product: a/c, topic: /x, latched: true}]",
            "output topic /x is latched for one product and not for another",
        ),
        (f"inputs: [{_IMU.replace('}', ', camera_info: /imu/data}')}]", "is an input and a camera_info"),
        (f"inputs: [{_IMU.replace('}', ', right: /imu/right}')}]", "a stereo camera: expected images, right"),
        (f"inputs: [{_FIX}]", "expected the location of frame site under origins"),
        (f"inputs: [{_FIX}]\norigins: {{site: [1.5, 91.0, 0.0]}}", "origins.site"),
        ("speed: 3", "speed"),
        (f"inputs: [{_IMU.replace('}', ', codec: xer}')}]", "codec"),
        (
            "requests: [{name: /dem, type: nav_msgs/srv/GetPlan}]",
            "expected one of grid_map_msgs/srv/GetGridMap",
        ),
        ("requests: [{name: /ask, type: cdff_msgs/srv/Request}]", "expected a list of products"),
        ("requests: [{name: /ask, type: cdff_msgs/srv/Request, products: [soil]}]", "product 'soil'"),
        ("requests: [{name: /dem, type: nav_msgs/srv/GetMap, products: [dem]}]", "expected no products"),
    ],
)
def test_settings_with_a_fault_are_refused_with_the_key(tmp_path: Path, text: str, reason: str) -> None:
    with pytest.raises(ConfigurationError, match=reason):
        _load(tmp_path, text)


def test_a_rate_limit_admits_a_burst_and_then_its_rate() -> None:
    limit = RateLimit(10.0)
    burst = [limit.admits(100.0) for _ in range(5)]
    assert burst == [True, True, True, False, False]
    assert [limit.admits(100.0 + 0.1 * i) for i in range(1, 4)] == [True, True, True]
    assert sum(limit.admits(200.0 + 0.01 * i) for i in range(1000)) == pytest.approx(100, abs=4)


def test_the_least_age_follows_a_clock_that_is_corrected() -> None:
    counters = TopicCounters()
    for i in range(100):
        counters.age(-3600.0 + 0.01 * (i % 3), 100.0 + 0.05 * i)
    assert counters.to_map()["least_age_ms"] == -3_600_000.0
    for i in range(600):
        counters.age(0.02 - 0.01 * (i % 2), 105.0 + 0.05 * i)
    assert counters.to_map()["least_age_ms"] == 10.0
    counters.age(5.0, 500.0)
    assert counters.to_map()["least_age_ms"] == 5000.0


def test_a_frame_tree_may_be_listed_once_for_each_transform_and_in_both_directions(tmp_path: Path) -> None:
    edges = [_EDGE.replace("STREAM", name).replace("CHILD", name) for name in ("base", "mast")]
    out = "{product: a/b, topic: /tf, type: tf2_msgs/msg/TFMessage}"
    settings = _load(tmp_path, f"inputs: [{', '.join(edges)}]\noutputs: [{out}]")
    assert [entry.stream for entry in settings.inputs] == ["tf/base", "tf/mast"]
    assert settings.inputs[0].service_quality == "default"


def test_several_products_may_have_one_topic_of_one_type(tmp_path: Path) -> None:
    text = "outputs: [{product: a/b, topic: /x, latched: true}, {product: a/c, topic: /x, latched: true}]"
    assert len(_load(tmp_path, text).outputs) == 2


def test_maps_and_static_transforms_are_latched_by_default(tmp_path: Path) -> None:
    static = _EDGE.replace("/tf,", "/tf_static,").replace("STREAM", "base").replace("CHILD", "base")
    outputs = [
        "{product: a/b, topic: /map, type: nav_msgs/msg/OccupancyGrid}",
        "{product: a/c, topic: /map_once, type: nav_msgs/msg/OccupancyGrid, latched: false}",
        "{product: a/d, topic: /pose, type: geometry_msgs/msg/PoseStamped}",
    ]
    settings = _load(tmp_path, f"inputs: [{static}]\noutputs: [{', '.join(outputs)}]")
    assert settings.inputs[0].service_quality == "latched"
    assert [entry.is_latched for entry in settings.outputs] == [True, False, False]


def test_the_package_of_ros_for_the_robot_has_the_definitions_of_the_gateway() -> None:
    folder = Path(__file__).resolve().parents[4] / "deploy" / "ros"
    definitions = {**SERVICES, **ACTIONS}
    for name, suffix in ((REQUEST_SERVICE, "srv"), (REQUEST_ACTION, "action")):
        text = (folder / "cdff_msgs" / suffix / f"Request.{suffix}").read_text(encoding="utf-8")
        assert text == definitions[name].definition
    text = (folder / "infuse_msgs" / "msg" / "Asn1Bitstream.msg").read_text(encoding="utf-8")
    types = get_types_from_msg(text, BITSTREAM)
    assert types[BITSTREAM] == RosTypes(2).store.fielddefs[BITSTREAM]


def test_messages_that_ros_1_lacks_are_refused_by_its_gateway() -> None:
    output = {
        "product": "target_detection/detections",
        "topic": "/objects",
        "type": "vision_msgs/msg/Detection3DArray",
    }
    Ros2Settings.model_validate({"robot": "mana", "outputs": [output]})
    with pytest.raises(ValidationError, match="exists in ROS 2 only"):
        Ros1Settings.model_validate({"robot": "mana", "outputs": [output]})

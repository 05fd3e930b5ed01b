# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Damaged messages of the robot are counted with a reason, and none of them ends the gateway."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from services.gateways.frames import FrameNames, FrameTree
from services.gateways.inputs import InputLink
from services.gateways.settings import InputTopic
from services.ros_messages.map_encoders import grid_map_message
from services.ros_messages.message_types import RosTypes

_STAMP_NS = 1_600_000_000_000_000_000
_MUTATIONS = 2000
_TYPES = {version: RosTypes(version) for version in (1, 2)}


class Samples:
    """The part of a sensor that an input uses."""

    def __init__(self, *_: object, **__: object) -> None:
        self.values: list[Any] = []

    def publish(self, value: Any, stamp_ns: int = 0) -> bool:
        assert stamp_ns or value.stamp_ns
        self.values.append(value)
        return True


def _messages(types: RosTypes) -> dict[str, tuple[Any, dict[str, str]]]:
    header = types.header(_STAMP_NS, "lidar")
    fields = [
        types.make("sensor_msgs/PointField", name=name, offset=4 * i, datatype=7, count=1)
        for i, name in enumerate("xyz")
    ]
    cloud = types.make(
        "sensor_msgs/PointCloud2",
        header=header,
        height=1,
        width=4,
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=48,
        data=np.arange(12, dtype=np.float32).view(np.uint8),
        is_dense=True,
    )
    transform = types.make(
        "geometry_msgs/TransformStamped",
        header=types.header(_STAMP_NS, "base"),
        child_frame_id="mast",
        transform=types.make(
            "geometry_msgs/Transform",
            translation=types.vector(np.ones(3)),
            rotation=types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
        ),
    )
    pose = types.make(
        "geometry_msgs/Pose",
        position=types.vector(np.zeros(3), "Point"),
        orientation=types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
    )
    info = types.make(
        "nav_msgs/MapMetaData", map_load_time=header.stamp, resolution=0.5, width=3, height=2, origin=pose
    )
    occupancy = types.make("nav_msgs/OccupancyGrid", header=header, info=info, data=np.zeros(6, np.int8))
    zero, layers = np.zeros(9), {"mean": np.zeros((2, 3), np.float32)}
    imu = types.make(
        "sensor_msgs/Imu",
        header=header,
        orientation=types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
        orientation_covariance=zero,
        angular_velocity=types.vector(np.zeros(3)),
        angular_velocity_covariance=zero,
        linear_acceleration=types.vector(np.zeros(3)),
        linear_acceleration_covariance=zero,
    )
    grid = grid_map_message(None, layers, types, _STAMP_NS, "lidar")
    grid.info.resolution, grid.info.length_x, grid.info.length_y = 1.0, 3.0, 2.0
    grid.info.pose.position.x = 0.5
    edge = {"frame": "mana/base", "child": "mana/mast"}
    return {
        "sensor_msgs/msg/PointCloud2": (cloud, {}),
        "sensor_msgs/msg/Imu": (imu, {}),
        "tf2_msgs/msg/TFMessage": (types.make("tf2_msgs/TFMessage", transforms=[transform]), edge),
        "nav_msgs/msg/OccupancyGrid": (occupancy, {}),
        "grid_map_msgs/msg/GridMap": (grid, {}),
    }


def _mutated(data: bytes, rng: np.random.Generator) -> bytes:
    """Return bytes with some changed, removed or repeated, or with a length of 4 GB."""
    damaged = bytearray(data)
    kind = rng.integers(4)
    at = int(rng.integers(len(damaged)))
    if kind == 0:
        for i in rng.integers(len(damaged), size=rng.integers(1, 4)):
            damaged[i] = rng.integers(256)
    elif kind == 1:
        del damaged[at:]
    elif kind == 2:
        damaged[at:at] = damaged[: rng.integers(1, 9)]
    else:
        damaged[at : at + 4] = b"\xff\xff\xff\xff"
    return bytes(damaged)


@pytest.mark.parametrize("version", [1, 2])
@pytest.mark.parametrize("name", sorted(_messages(_TYPES[2])))
def test_each_damaged_message_is_a_sample_or_counted(
    version: int, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("services.gateways.sample_link.Sensor", Samples)
    types = _TYPES[version]
    message, frames = _messages(types)[name]
    entry = InputTopic.model_validate(
        {"topic": "/t", "type": name, "stream": "s/t", "frame": "mana/lidar", "max_hz": 1e9, **frames}
    )
    link = InputLink(entry, FrameNames("mana"), types, None, FrameTree())  # type: ignore[arg-type]
    data = bytes(types.serialize(message, name))
    link.on_message(data)
    samples: Any = link.sensor
    assert len(samples.values) == 1, link.counters.to_map()
    rng = np.random.default_rng(version)
    for _ in range(_MUTATIONS):
        link.on_message(_mutated(data, rng))
    counters = link.counters.to_map()
    assert counters["received"] == _MUTATIONS + 1
    assert counters["forwarded"] == len(samples.values)
    assert sum(counters["dropped"].values()) > _MUTATIONS // 10
    if name != "tf2_msgs/msg/TFMessage":  # of which a message may have other transforms
        assert counters["forwarded"] + sum(counters["dropped"].values()) == counters["received"]

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rover with ROS 2 on Zenoh by zenoh-ros2-sdk: test_framework_rovers.py runs it in its environment.

``ros2_rover.py PORT DRIVE.npz`` publishes the sweeps of a drive, then repeats the last one until pose, frame
tree, map and the DEM of a service have arrived, and prints these as JSON.
"""

from __future__ import annotations

import json
import math
import sys
import threading
import time
from typing import Any

import numpy as np
from program_exit import run_and_exit
from rosbags.typesys import Stores, get_typestore

CLOUD, POSE = "sensor_msgs/msg/PointCloud2", "geometry_msgs/msg/PoseWithCovarianceStamped"
TREE, MAP = "tf2_msgs/msg/TFMessage", "nav_msgs/msg/OccupancyGrid"
GRID_MAP_SERVICE = "grid_map_msgs/srv/GetGridMap"
REQUEST = (
    "string frame_id\nfloat64 position_x\nfloat64 position_y\n"
    "float64 length_x\nfloat64 length_y\nstring[] layers"
)
RESPONSE = "grid_map_msgs/GridMap map"
GRID_MAP = {
    "grid_map_msgs/msg/GridMapInfo": (
        "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose"
    ),
    "grid_map_msgs/msg/GridMap": (
        "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
        "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index"
    ),
}
PERIOD_S, LIMIT_S = 0.5, 120.0


def definitions(name: str) -> dict[str, str]:
    """Return the text of a type and of all that it contains, innermost first, by name."""
    text, _ = get_typestore(Stores.ROS2_KILTED).generate_msgdef(name, ros_version=2)
    first, *others = text.split("=" * 80 + "\n")
    body_by_type = {name: first}
    for other in others:
        head, _, body = other.partition("\n")
        package, kind = head.removeprefix("MSG: ").strip().replace("/msg/", "/").split("/")
        body_by_type[f"{package}/msg/{kind}"] = body
    return dict(reversed(body_by_type.items()))


class Rover:
    """The program: one publisher, three subscribers and a client of a service."""

    def __init__(self, port: int) -> None:
        from zenoh_ros2_sdk.publisher import ROS2Publisher
        from zenoh_ros2_sdk.qos import QosDurability, QosProfile
        from zenoh_ros2_sdk.service_client import ROS2ServiceClient
        from zenoh_ros2_sdk.session import ZenohSession
        from zenoh_ros2_sdk.subscriber import ROS2Subscriber
        from zenoh_ros2_sdk.utils import compute_service_type_hash, get_type_hash

        self.types: dict[str, str] = {}
        for name in (CLOUD, POSE, TREE, MAP, "std_msgs/msg/Float32MultiArray"):
            self.types |= definitions(name)
        self.types |= GRID_MAP
        session = ZenohSession.get_instance("127.0.0.1", port)
        for name, text in self.types.items():
            session.register_message_type(text, name)
        self.store = session.store
        router: dict[str, Any] = {"router_ip": "127.0.0.1", "router_port": port}
        latched = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1)
        self.received: dict[str, list[Any]] = {"/cdff/pose": [], "/tf": [], "/map": []}
        self.lock = threading.Lock()

        def common(kind: str) -> dict[str, Any]:
            type_hash = get_type_hash(kind, msg_definition=self.types[kind], dependencies=self.types)
            return {"msg_definition": self.types[kind], "type_hash": type_hash, **router}

        for topic, kind in (("/cdff/pose", POSE), ("/tf", TREE), ("/map", MAP)):
            quality = {"qos": latched} if topic == "/map" else {}
            ROS2Subscriber(topic, kind, self._take(topic), **common(kind), **quality)
        self.publisher = ROS2Publisher("/lidar/points", CLOUD, **common(CLOUD))
        self.client = ROS2ServiceClient(
            "/cdff/get_dem",
            GRID_MAP_SERVICE,
            request_definition=REQUEST,
            response_definition=RESPONSE,
            type_hash=compute_service_type_hash(GRID_MAP_SERVICE, REQUEST, RESPONSE, self.types),
            timeout=20.0,
            **router,
        )

    def _take(self, topic: str) -> Any:
        def on_message(message: Any) -> None:
            with self.lock:
                self.received[topic].append(message)

        return on_message

    def make(self, kind: str, /, **fields: Any) -> Any:
        """Return a message of a type."""
        return self.store.types[kind](**fields)

    def publish(self, points: Any, offsets_ns: Any) -> int:
        """Publish a sweep that began a sweep ago; return its stamp in nanoseconds."""
        stamp_ns = (time.time_ns() - 100_000_000) // 1000 * 1000
        fields = [("x", 0, 7), ("y", 4, 7), ("z", 8, 7), ("t", 12, 6)]
        records = np.zeros(len(points), [(name, "<f4" if kind == 7 else "<u4") for name, _, kind in fields])
        for i, name in enumerate("xyz"):
            records[name] = points[:, i]
        records["t"] = offsets_ns
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        self.publisher.publish(
            header=self.make("std_msgs/msg/Header", stamp=stamp, frame_id="lidar"),
            height=1,
            width=len(points),
            fields=[
                self.make("sensor_msgs/msg/PointField", name=name, offset=offset, datatype=kind, count=1)
                for name, offset, kind in fields
            ],
            is_bigendian=False,
            point_step=16,
            row_step=16 * len(points),
            data=records.view(np.uint8),
            is_dense=False,
        )
        return stamp_ns

    def has_all(self) -> bool:
        """Return whether each topic has a message."""
        with self.lock:
            return all(self.received.values())

    def heights(self) -> dict[str, Any] | None:
        """Return the DEM of the service, or None if it has no cells."""
        answer = self.client.call(
            frame_id="map", position_x=2.0, position_y=0.0, length_x=4.0, length_y=4.0, layers=["mean"]
        )
        if answer is None or not answer.map.data or not len(answer.map.data[0].data):
            return None
        info, values = answer.map.info, answer.map.data[0].data
        return {
            "frame_id": answer.map.header.frame_id,
            "resolution": float(info.resolution),
            "lengths": [float(info.length_x), float(info.length_y)],
            "position": [float(info.pose.position.x), float(info.pose.position.y)],
            "values": [float(v) if math.isfinite(v) else None for v in values],
        }


def stamp_of(header: Any) -> int:
    """Return the stamp of a header in nanoseconds."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)


def pose_of(stamp_ns: int, position: Any, q: Any) -> list[float]:
    """Return stamp, position and quaternion x y z w."""
    return [stamp_ns, *(float(v) for v in (position.x, position.y, position.z, q.x, q.y, q.z, q.w))]


def main() -> None:
    rover = Rover(int(sys.argv[1]))
    drive = np.load(sys.argv[2])
    points, offsets_ns = drive["points"], drive["offsets_ns"]
    starts_ns, dem, end_s = [], None, time.monotonic() + LIMIT_S
    while time.monotonic() < end_s and dem is None:
        began_s = time.monotonic()
        starts_ns.append(rover.publish(points[min(len(starts_ns), len(points) - 1)], offsets_ns))
        if len(starts_ns) > len(points) + 4 and rover.has_all():
            dem = rover.heights()
        time.sleep(max(PERIOD_S - (time.monotonic() - began_s), 0.0))
    with rover.lock:
        poses, trees, maps = (list(rover.received[topic]) for topic in ("/cdff/pose", "/tf", "/map"))
    edges = [edge for message in trees for edge in message.transforms]
    grid = maps[-1] if maps else None
    result = {
        "starts_ns": starts_ns,
        "poses": [pose_of(stamp_of(m.header), m.pose.pose.position, m.pose.pose.orientation) for m in poses],
        "pose_frames": sorted({m.header.frame_id for m in poses}),
        "tree": [pose_of(stamp_of(e.header), e.transform.translation, e.transform.rotation) for e in edges],
        "tree_frames": sorted({(e.header.frame_id, e.child_frame_id) for e in edges}),
        "map": grid
        and {
            "frame_id": grid.header.frame_id,
            "size": [int(grid.info.width), int(grid.info.height)],
            "cells": {str(v): int(n) for v, n in zip(*np.unique(grid.data, return_counts=True), strict=True)},
        },
        "dem": dem,
    }
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    run_and_exit(main)

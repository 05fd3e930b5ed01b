# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS 2 program of another implementation, zenoh-ros2-sdk: test_gateway_ros2_requests.py runs it.

``ros2_sdk_peer.py PORT`` waits for a latched ``/map``, calls ``GetGridMap``, and prints both as JSON.
Definitions of types and their hashes are its own, from rosbags and from the library.

``ros2_sdk_peer.py --hashes`` prints the hashes of all messages and services of ros2-pyterfaces.
"""

from __future__ import annotations

import json
import os
import queue
import sys
from typing import Any

MAP, GRID_MAP_SERVICE = "nav_msgs/msg/OccupancyGrid", "grid_map_msgs/srv/GetGridMap"
REQUEST = (
    "string frame_id\nfloat64 position_x\nfloat64 position_y\n"
    "float64 length_x\nfloat64 length_y\nstring[] layers"
)
RESPONSE = "grid_map_msgs/GridMap map"
OWN = {
    "grid_map_msgs/msg/GridMapInfo": (
        "float64 resolution\nfloat64 length_x\nfloat64 length_y\ngeometry_msgs/Pose pose"
    ),
    "grid_map_msgs/msg/GridMap": (
        "std_msgs/Header header\ngrid_map_msgs/GridMapInfo info\nstring[] layers\nstring[] basic_layers\n"
        "std_msgs/Float32MultiArray[] data\nuint16 outer_start_index\nuint16 inner_start_index"
    ),
}


def definitions(name: str) -> dict[str, str]:
    """Return the text of a type and of all that it contains, innermost first, by name."""
    from rosbags.typesys import Stores, get_typestore

    text, _ = get_typestore(Stores.ROS2_KILTED).generate_msgdef(name, ros_version=2)
    first, *others = text.split("=" * 80 + "\n")
    body_by_type = {name: first}
    for other in others:
        head, _, body = other.partition("\n")
        package, kind = head.removeprefix("MSG: ").strip().replace("/msg/", "/").split("/")
        body_by_type[f"{package}/msg/{kind}"] = body
    return dict(reversed(body_by_type.items()))


def run(port: int) -> None:
    """Print the map and the answer of the service."""
    from zenoh_ros2_sdk.qos import QosDurability, QosProfile
    from zenoh_ros2_sdk.service_client import ROS2ServiceClient
    from zenoh_ros2_sdk.session import ZenohSession
    from zenoh_ros2_sdk.subscriber import ROS2Subscriber
    from zenoh_ros2_sdk.utils import compute_service_type_hash, get_type_hash

    session = ZenohSession.get_instance("127.0.0.1", port)
    types = {
        **definitions(MAP),
        **definitions("geometry_msgs/msg/Pose"),
        **definitions("std_msgs/msg/Float32MultiArray"),
        **OWN,
    }
    for name, text in types.items():
        session.register_message_type(text, name)
    maps: queue.Queue[Any] = queue.Queue()
    type_hash = get_type_hash(MAP, msg_definition=types[MAP], dependencies=types)
    quality = QosProfile(durability=QosDurability.TRANSIENT_LOCAL, history_depth=1)
    common = {"router_ip": "127.0.0.1", "router_port": port}
    ROS2Subscriber(
        "/map", MAP, maps.put, msg_definition=types[MAP], type_hash=type_hash, qos=quality, **common
    )
    grid = maps.get(timeout=20)
    client = ROS2ServiceClient(
        "/cdff/get_dem",
        GRID_MAP_SERVICE,
        request_definition=REQUEST,
        response_definition=RESPONSE,
        type_hash=compute_service_type_hash(GRID_MAP_SERVICE, REQUEST, RESPONSE, types),
        timeout=20.0,
        **common,
    )
    answer = client.call(
        frame_id="map", position_x=1.0, position_y=1.0, length_x=2.0, length_y=1.0, layers=["mean", "count"]
    )
    result = {
        "map": {
            "frame_id": grid.header.frame_id,
            "size": [int(grid.info.width), int(grid.info.height)],
            "data": [int(v) for v in grid.data],
        },
        "dem": {
            "frame_id": answer.map.header.frame_id,
            "layers": list(answer.map.layers),
            "lengths": [answer.map.info.length_x, answer.map.info.length_y],
            "values": [sorted({float(v) for v in array.data}) for array in answer.map.data],
        },
    }
    print(json.dumps(result), flush=True)
    os._exit(0)


def print_hashes() -> None:
    """Print the hashes of ros2-pyterfaces."""
    from ros2_pyterfaces.cyclone import all_msgs, all_srvs

    hashes = {}
    for module in (all_msgs, all_srvs):
        for kind in vars(module).values():
            if isinstance(kind, type) and hasattr(kind, "hash_rihs01") and hasattr(kind, "get_type_name"):
                try:
                    hashes[kind.get_type_name()] = kind.hash_rihs01()
                except (AttributeError, NotImplementedError, TypeError, ValueError):  # base classes
                    continue
    print(json.dumps(hashes))


if __name__ == "__main__":
    if sys.argv[1] == "--hashes":
        print_hashes()
    else:
        run(int(sys.argv[1]))

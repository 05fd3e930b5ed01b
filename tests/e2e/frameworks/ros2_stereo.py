# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A rover with a stereo camera and ROS 2 on Zenoh by zenoh-ros2-sdk: test_framework_rovers.py runs it.

``ros2_stereo.py PORT PAIRS.npz`` repeats the first pair of images until the first pose arrives, publishes the
others, and prints the poses of visual odometry as JSON when one of the last pair has arrived.
"""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

import numpy as np
from program_exit import run_and_exit
from ros2_rover import POSE, TREE, definitions, pose_of, stamp_of

IMAGE, INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
PERIOD_S, LIMIT_S = 0.4, 120.0


class StereoRover:
    """The program: publishers of four topics, and subscribers of poses and the frame tree."""

    def __init__(self, port: int) -> None:
        from zenoh_ros2_sdk.publisher import ROS2Publisher
        from zenoh_ros2_sdk.session import ZenohSession
        from zenoh_ros2_sdk.subscriber import ROS2Subscriber
        from zenoh_ros2_sdk.utils import get_type_hash

        types: dict[str, str] = {}
        for name in (IMAGE, INFO, POSE, TREE):
            types |= definitions(name)
        session = ZenohSession.get_instance("127.0.0.1", port)
        for name, text in types.items():
            session.register_message_type(text, name)
        self.store = session.store
        self.poses: list[Any] = []
        self.trees: list[Any] = []
        self.lock = threading.Lock()

        def common(kind: str) -> dict[str, Any]:
            type_hash = get_type_hash(kind, msg_definition=types[kind], dependencies=types)
            definition = {"msg_definition": types[kind], "type_hash": type_hash}
            return {**definition, "router_ip": "127.0.0.1", "router_port": port}

        ROS2Subscriber("/cdff/pose", POSE, self._take(self.poses), **common(POSE))
        ROS2Subscriber("/tf", TREE, self._take(self.trees), **common(TREE))
        self.publishers = {
            (side, kind): ROS2Publisher(f"/navcam/{side}/{name}", kind, **common(kind))
            for side in ("left", "right")
            for name, kind in (("camera_info", INFO), ("image_rect", IMAGE))
        }

    def _take(self, messages: list[Any]) -> Any:
        def on_message(message: Any) -> None:
            with self.lock:
                messages.append(message)

        return on_message

    def make(self, kind: str, /, **fields: Any) -> Any:
        """Return a message of a type."""
        return self.store.types[kind](**fields)

    def publish(self, pair: Any, K: Any, baseline_m: float) -> int:
        """Publish a pair (2, rows, columns) of now with its calibrations; return its stamp in nanoseconds."""
        stamp_ns = time.time_ns() // 1000 * 1000
        stamp = self.make("builtin_interfaces/msg/Time", sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
        rows, columns = pair.shape[1:]
        for side, image, offset_m in zip(("left", "right"), pair, (0.0, baseline_m), strict=True):
            header = self.make("std_msgs/msg/Header", stamp=stamp, frame_id=f"navcam_{side}")
            P = np.zeros((3, 4))
            P[:, :3], P[0, 3] = K, -K[0, 0] * offset_m
            region = self.make(
                "sensor_msgs/msg/RegionOfInterest",
                x_offset=0,
                y_offset=0,
                height=0,
                width=0,
                do_rectify=False,
            )
            size = {"height": rows, "width": columns}
            self.publishers[side, INFO].publish(
                header=header,
                **size,
                distortion_model="plumb_bob",
                d=np.zeros(5),
                k=K.ravel(),
                r=np.eye(3).ravel(),
                p=P.ravel(),
                binning_x=0,
                binning_y=0,
                roi=region,
            )
            self.publishers[side, IMAGE].publish(
                header=header, **size, encoding="mono8", is_bigendian=0, step=columns, data=image.ravel()
            )
        return stamp_ns

    def has_pose_since(self, stamp_ns: int) -> bool:
        """Return whether a pose has a stamp, or a later one."""
        with self.lock:
            return any(stamp_of(message.header) >= stamp_ns for message in self.poses)


def main() -> None:
    rover, content = StereoRover(int(sys.argv[1])), np.load(sys.argv[2])
    pairs, K, baseline_m = content["pairs"], content["K"], float(content["baseline_m"])
    end_s, stamps_ns, first_ns = time.monotonic() + LIMIT_S, [], 0
    while time.monotonic() < end_s and not (first_ns and rover.has_pose_since(first_ns)):
        last_ns = rover.publish(pairs[0], K, baseline_m)
        first_ns = first_ns or last_ns
        time.sleep(PERIOD_S)
    for pair in pairs[1:]:
        stamps_ns.append(rover.publish(pair, K, baseline_m))
        time.sleep(PERIOD_S)
    while time.monotonic() < end_s and not rover.has_pose_since(stamps_ns[-1]):
        time.sleep(0.1)
    with rover.lock:
        poses, trees = list(rover.poses), list(rover.trees)
    edges = [edge for message in trees for edge in message.transforms]
    result = {
        "stamps_ns": stamps_ns,
        "poses": [pose_of(stamp_of(m.header), m.pose.pose.position, m.pose.pose.orientation) for m in poses],
        "pose_frames": sorted({m.header.frame_id for m in poses}),
        "tree": [
            [
                e.header.frame_id,
                e.child_frame_id,
                pose_of(stamp_of(e.header), e.transform.translation, e.transform.rotation),
            ]
            for e in edges
        ],
    }
    print(json.dumps(result), flush=True)


if __name__ == "__main__":
    run_and_exit(main)

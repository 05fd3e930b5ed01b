# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A ROS 2 program of another implementation, pyzeros: test_gateway_ros2.py runs it in its environment.

``ros2_peer.py ENDPOINT`` publishes IMU samples until it has received three poses, and prints them as JSON.
``ros2_peer.py --compile`` compiles the codecs of its messages, once for an environment: it takes a minute for
each, during which a program of pyzeros neither sends nor receives.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import time
import traceback
from pathlib import Path

# The default is the working folder, which is a new one for each test.
os.environ.setdefault("CYDR_CACHE_DIR", str(Path(sys.prefix) / "cydr"))

import asyncio_for_robotics as afor
import pyzeros
import zenoh
from pyzeros.builtin_msgs import Attachment
from ros2_pyterfaces.cydr.all_msgs import Header, Imu, PoseWithCovarianceStamped, Time, Vector3

POSES = 3


@afor.scoped
async def exchange() -> None:
    publisher = pyzeros.Pub(Imu, "/imu/data")
    poses = pyzeros.Sub(PoseWithCovarianceStamped, "/cdff/pose")

    async def publish() -> None:
        while True:
            stamp_ns = time.time_ns()
            stamp = Time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
            header = Header(stamp=stamp, frame_id=b"imu_link")
            acceleration = Vector3(x=0.25, y=0.5, z=9.75)
            rate = Vector3(x=0.0, y=0.0, z=0.125)
            publisher.publish(Imu(header=header, linear_acceleration=acceleration, angular_velocity=rate))
            await asyncio.sleep(0.02)

    task = asyncio.create_task(publish())
    task.add_done_callback(lambda _: os._exit(1))
    exit_status = 1
    received = 0
    try:
        async for pose in poses.listen_reliable():
            position = pose.pose.pose.position
            fields = {
                "frame_id": pose.header.frame_id.decode(),
                "position": [float(position.x), float(position.y), float(position.z)],
                "covariance": [float(v) for v in pose.pose.covariance],
            }
            print(json.dumps(fields), flush=True)
            received += 1
            if received == POSES:
                exit_status = 0
                break
    except Exception:
        traceback.print_exc()
        raise
    finally:
        os._exit(exit_status)  # the end of the scope waits for the subscription


def compile_codecs() -> None:
    for message_type in (Attachment, Imu, PoseWithCovarianceStamped):
        message_type.deserialize(bytes(message_type().serialize()))


def main() -> None:
    compile_codecs()
    if sys.argv[1] == "--compile":
        return
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [sys.argv[1]]),
        ("scouting/multicast/enabled", False),
    ):
        config.insert_json5(key, json.dumps(value))
    with zenoh.open(config) as session, pyzeros.auto_context(node="peer", zenoh_session=session):
        asyncio.run(exchange())


if __name__ == "__main__":
    main()

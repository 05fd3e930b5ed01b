# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Latency that the gateway to ROS 1 adds to an IMU sample, compared with its bytes over TCPROS and Zenoh.

    python benchmarks/gateway_ros1.py [--out FILE] [--rounds N]

Router and gateway are processes. A node publishes ``sensor_msgs/Imu`` (about 0.3 kB), one message at a time.
``raw`` is the time to a subscription of a second node in this process, plus that of the same bytes over the
router; ``gateway`` is the time to the sample on the bus. A master in this process introduces the nodes.
"""

from __future__ import annotations

import argparse
import os
import queue
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any
from xmlrpc.server import SimpleXMLRPCServer

import numpy as np
from _report import write_report
from _services import Services

from cdff_common.bus import Bus, Qos, keys
from cdff_common.clock import wall_ns
from services.gateway_ros1.node import Ros1Node
from services.ros_messages.encoding import Outgoing
from services.ros_messages.message_types import RosTypes

IMU, TOPIC = "sensor_msgs/msg/Imu", "/imu"
TIMEOUT_S = 20.0
SETTINGS = f"""robot: mana
inputs:
  - {{topic: {TOPIC}, type: {IMU}, stream: imu/sample, frame: mana/imu}}
"""


class Master:
    """The part of a master that introduces the publishers of a topic to its subscribers."""

    def __init__(self) -> None:
        self._server = SimpleXMLRPCServer(("127.0.0.1", 0), logRequests=False, allow_none=True)
        self.uri = f"http://127.0.0.1:{self._server.server_address[1]}"
        self._publishers: dict[str, list[str]] = {}
        for name in ("getPid", "unregisterPublisher", "unregisterSubscriber"):
            self._server.register_function(lambda *_: [1, "", os.getpid()], name)
        self._server.register_function(lambda *_: [1, "", {}], "subscribeParam")
        self._server.register_function(self._register_publisher, "registerPublisher")
        self._server.register_function(self._register_subscriber, "registerSubscriber")
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def _register_publisher(self, *arguments: Any) -> list[Any]:
        _, topic, _, uri = arguments
        self._publishers.setdefault(topic, []).append(uri)
        return [1, "", []]

    def _register_subscriber(self, *arguments: Any) -> list[Any]:
        return [1, "", self._publishers.get(arguments[1], [])]


def sample(types: RosTypes) -> Any:
    """Return an IMU sample with the stamp of now."""
    zero = np.zeros(9)
    return types.make(
        "sensor_msgs/Imu",
        header=types.header(wall_ns(), "imu"),
        orientation=types.quaternion(np.array([0.0, 0.0, 0.0, 1.0])),
        orientation_covariance=zero,
        angular_velocity=types.vector(np.zeros(3)),
        angular_velocity_covariance=zero,
        linear_acceleration=types.vector(np.zeros(3)),
        linear_acceleration_covariance=zero,
    )


def latencies_ms(endpoint: str, node: Ros1Node, rounds: int) -> dict[str, list[float]]:
    """Return the latencies of messages by TCPROS, over the router, and through the gateway."""
    received: dict[str, queue.Queue[float]] = {n: queue.Queue() for n in ("tcpros", "zenoh", "gateway")}
    latencies_by_route: dict[str, list[float]] = {name: [] for name in received}

    def arrived(name: str) -> Any:
        return lambda _: received[name].put(time.perf_counter())

    other = Ros1Node(node.master_uri, "127.0.0.1", "/other", node.types)
    other.subscribe(TOPIC, IMU, arrived("tcpros"), lambda *_: None, max_bytes=10_000)
    other.start()
    with (
        Bus.open(endpoint, name="sender", wait_s=20.0) as sender,
        Bus.open(endpoint, name="client") as client,
    ):
        client.subscribe("benchmark/raw", arrived("zenoh"))
        client.subscribe(keys.sensor("mana", "imu", "sample"), arrived("gateway"))
        deadline_s = time.monotonic() + 60.0
        while len(node.connections()) < 2:
            if time.monotonic() > deadline_s:
                raise TimeoutError("the gateway is not connected after 60 s")
            time.sleep(0.1)
        time.sleep(1.0)
        for i in range(rounds + 20):
            message = sample(node.types)
            data = bytes(node.types.serialize(message, IMU))
            start_s = time.perf_counter()
            node.publish(Outgoing(TOPIC, IMU, message), latched=False)
            times = {name: received[name].get(timeout=TIMEOUT_S) - start_s for name in ("tcpros", "gateway")}
            start_s = time.perf_counter()
            sender.publish("benchmark/raw", data, qos=Qos.POSE)
            times["zenoh"] = received["zenoh"].get(timeout=TIMEOUT_S) - start_s
            if i >= 20:
                for name, value in times.items():
                    latencies_by_route[name].append(1e3 * value)
    other.close()
    return latencies_by_route


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=500)
    args = parser.parse_args()
    master = Master()
    node = Ros1Node(master.uri, "127.0.0.1", "/robot", RosTypes(1))
    node.declare_publisher(TOPIC, IMU, latched=False)
    node.start()
    while not node.is_registered:
        time.sleep(0.05)
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "gateway.yaml"
        settings.write_text(SETTINGS, encoding="utf-8")
        with Services(Path(folder), with_dpm=False) as services:
            command = [sys.executable, "-m", "services.gateway_ros1", "--settings", str(settings)]
            command += ["--connect", services.endpoint, "--master", master.uri]
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as gateway:
                try:
                    latencies_by_route = latencies_ms(services.endpoint, node, args.rounds)
                finally:
                    gateway.terminate()
    node.close()
    raw = [a + b for a, b in zip(latencies_by_route["tcpros"], latencies_by_route["zenoh"], strict=True)]
    report = {
        name: {
            "p50_ms": round(statistics.median(times), 3),
            "p10_ms": round(float(np.quantile(times, 0.1)), 3),
        }
        for name, times in {"raw": raw, **latencies_by_route}.items()
    }
    added = {q: round(report["gateway"][q] - report["raw"][q], 3) for q in ("p50_ms", "p10_ms")}
    write_report(
        {"rounds": args.rounds, **report, "added": added, "load": round(os.getloadavg()[0], 1)}, args.out
    )


if __name__ == "__main__":
    main()

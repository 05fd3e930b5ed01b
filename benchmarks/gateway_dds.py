# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Latency that the gateway to ROS 2 on DDS adds to a cloud, compared with its bytes over DDS and Zenoh.

    PYTHONPATH=build/cyclonedds python benchmarks/gateway_dds.py [--out FILE] [--rounds N]

Router and gateway are processes. A program publishes a ``PointCloud2`` of 1 MB with Cyclone DDS, one message
at a time. ``dds`` is the time to a reader of a second participant in this process, ``zenoh`` that of the same
bytes over the router, ``raw`` their sum; ``gateway`` is the time to the sample of MessagePack on the bus.
"""

from __future__ import annotations

import argparse
import os
import queue
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report
from _services import Services, cpu_s
from cyclonedds.core import Listener
from cyclonedds.domain import DomainParticipant
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from gateway_ros2 import CLOUD, POINTS, cloud

from cdff_common.bus import Bus, Qos, keys
from services.gateway_dds.raw_types import RawTypes
from services.gateway_dds.robot_node import RobotNode, quality_of_service
from services.gateway_dds.settings import DdsSettings
from services.ros_messages.message_types import RosTypes

TOPIC, TIMEOUT_S, _WARM_UP = "/points", 20.0, 5
INPUT = {"topic": TOPIC, "type": CLOUD, "stream": "lidar/scan", "frame": "mana/lidar", "codec": "msgpack"}


class RawReader:
    """Reader of clouds of a second participant, which notes the arrivals."""

    def __init__(self, domain: int, types: RosTypes, received: queue.Queue[float]) -> None:
        def on_data(reader: Any) -> None:
            for _ in reader.take(1):
                received.put(time.perf_counter())

        listener = Listener(on_data_available=on_data)
        participant = DomainParticipant(domain)
        topic = Topic(participant, f"rt{TOPIC}", RawTypes(types).of(CLOUD))
        self.reader = DataReader(participant, topic, qos=quality_of_service("default", 10), listener=listener)


def latencies_ms(
    endpoint: str, node: RobotNode, domain: int, rounds: int, gateway_pid: int
) -> tuple[dict[str, list[float]], float]:
    """Return the latencies of messages by DDS, over the router, and through the gateway, and its CPU time."""
    received: dict[str, queue.Queue[float]] = {name: queue.Queue() for name in ("dds", "zenoh", "gateway")}
    latencies_by_route: dict[str, list[float]] = {name: [] for name in received}
    reader = RawReader(domain, node.types, received["dds"])
    node.declare_publisher(TOPIC, CLOUD, latched=False)
    points = np.random.default_rng(0).random((POINTS, 3), np.float32)

    def arrived(name: str) -> Any:
        return lambda _: received[name].put(time.perf_counter())

    with (
        Bus.open(endpoint, name="sender", wait_s=20.0) as sender,
        Bus.open(endpoint, name="client") as client,
    ):
        client.subscribe("benchmark/raw", arrived("zenoh"))
        client.subscribe(keys.sensor("mana", "lidar", "scan"), arrived("gateway"))
        deadline_s = time.monotonic() + 60.0
        while node.subscribers(TOPIC, CLOUD) < 2:
            if time.monotonic() > deadline_s:
                raise TimeoutError("the gateway is not connected after 60 s")
            time.sleep(0.1)
        time.sleep(1.0)
        start_cpu_s = 0.0
        for i in range(rounds + _WARM_UP):
            data = cloud(node.types, points)
            start_s = time.perf_counter()
            node.publish_bytes(TOPIC, CLOUD, data)
            times = {name: received[name].get(timeout=TIMEOUT_S) - start_s for name in ("dds", "gateway")}
            start_s = time.perf_counter()
            sender.publish("benchmark/raw", data, qos=Qos.STREAM)
            times["zenoh"] = received["zenoh"].get(timeout=TIMEOUT_S) - start_s
            if i == _WARM_UP - 1:
                start_cpu_s = cpu_s(gateway_pid)
            if i >= _WARM_UP:
                for name, value in times.items():
                    latencies_by_route[name].append(1e3 * value)
        cpu_ms = 1e3 * (cpu_s(gateway_pid) - start_cpu_s) / rounds
    del reader
    return latencies_by_route, cpu_ms


def main() -> None:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=200)
    args = parser.parse_args()
    domain = 1 + os.getpid() % 200
    body = {"robot": "mana", "domain": domain, "inputs": [{**INPUT, "qos": "default"}]}
    node = RobotNode(DdsSettings.model_validate(body), RosTypes(2))
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "gateway.yaml"
        settings.write_text(str(body), encoding="utf-8")
        with Services(Path(folder), with_dpm=False) as services:
            command = [sys.executable, "-m", "services.gateway_dds", "--settings", str(settings)]
            command += ["--connect", services.endpoint]
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as gateway:
                try:
                    latencies_by_route, cpu_ms = latencies_ms(
                        services.endpoint, node, domain, args.rounds, gateway.pid
                    )
                finally:
                    gateway.terminate()
    raw = [a + b for a, b in zip(latencies_by_route["dds"], latencies_by_route["zenoh"], strict=True)]
    report: dict[str, Any] = {
        name: {
            "p50_ms": round(statistics.median(times), 2),
            "p10_ms": round(float(np.quantile(times, 0.1)), 2),
        }
        for name, times in {"raw": raw, **latencies_by_route}.items()
    }
    report["added"] = {q: round(report["gateway"][q] - report["raw"][q], 2) for q in ("p50_ms", "p10_ms")}
    mb_per_cpu_s = round(12e-6 * POINTS / (1e-3 * cpu_ms))
    report["gateway_cpu"] = {"ms": round(cpu_ms, 2), "mb_per_cpu_s": mb_per_cpu_s}
    write_report({"rounds": args.rounds, **report, "load": round(os.getloadavg()[0], 1)}, args.out)


if __name__ == "__main__":
    main()

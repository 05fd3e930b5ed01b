# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Latency that the gateway to ROS 2 adds to a cloud, compared with the same bytes over the same router.

    python benchmarks/gateway_ros2.py [--out FILE] [--rounds N]

Router and gateway are processes. A program publishes a ``PointCloud2`` of 1 MB under a key without the
gateway (``raw``), and under the key of the topic (``gateway``), in turn, one message at a time; it receives
both, the second as a sample of MessagePack. ``sample`` is that of the bytes of the sample, which has more,
without the gateway. ``added`` is the time with the gateway minus ``raw``; ``alone`` is the time minus ``raw``
and ``sample``, that in the gateway without the two ways over the router. ``gateway_cpu`` is the CPU time of
the gateway's process for a cloud. ``mb_per_s`` is the rate at which clouds arrive if at most four of them are
in flight.
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

from cdff_common.bus import Bus, Message, keys
from cdff_common.clock import wall_ns
from services.gateway_ros2 import rmw_zenoh
from services.ros_messages.message_types import RosTypes
from services.ros_messages.type_hashes import message_hash

CLOUD = "sensor_msgs/msg/PointCloud2"
POINTS = 83_333  # 12 bytes each
TIMEOUT_S, _WARM_UP = 20.0, 5
#: Clouds that are sent as fast as possible, and of these the number in flight.
_BURST, _IN_FLIGHT = 60, 4
SETTINGS = f"""robot: mana
inputs:
  - {{topic: /points, type: {CLOUD}, stream: lidar/scan, frame: mana/lidar, codec: msgpack}}
"""


def cloud(types: RosTypes, points: Any) -> bytes:
    """Return the CDR bytes of a cloud with the stamp of now."""
    fields = [
        types.make("sensor_msgs/PointField", name=name, offset=4 * i, datatype=7, count=1)
        for i, name in enumerate("xyz")
    ]
    message = types.make(
        "sensor_msgs/PointCloud2",
        header=types.header(wall_ns(), "lidar"),
        height=1,
        width=len(points),
        fields=fields,
        is_bigendian=False,
        point_step=12,
        row_step=12 * len(points),
        data=points.reshape(-1).view(np.uint8),
        is_dense=True,
    )
    return bytes(types.serialize(message, CLOUD))


def rate_mb_per_s(robot: Bus, key: str, clouds: list[bytes], received: queue.Queue[float]) -> float:
    """Return the rate at which clouds arrive, at most four in flight."""
    start_s = end_s = time.perf_counter()
    for i, data in enumerate(clouds):
        attachment = rmw_zenoh.Attachment(i + 1, wall_ns(), bytes(16)).to_bytes()
        robot.publish(key, data, encoding=rmw_zenoh.ENCODING, attachment=attachment)
        if i >= _IN_FLIGHT:
            end_s = received.get(timeout=TIMEOUT_S)
    for _ in range(min(_IN_FLIGHT, len(clouds))):
        end_s = received.get(timeout=TIMEOUT_S)
    return 1e-6 * sum(map(len, clouds)) / (end_s - start_s)


def latencies_ms(
    endpoint: str, rounds: int, gateway_pid: int
) -> tuple[dict[str, list[float]], float, dict[str, float]]:
    """Return the latencies of messages without and with the gateway in ms, the CPU time that the gateway
    needs for a message in ms, and the rates without and with it in MB/s.
    """
    types = RosTypes(2)
    topic = rmw_zenoh.data_key(0, "/points", CLOUD, message_hash(types.store.fielddefs, CLOUD))
    targets = {"raw": "benchmark/raw", "sample": "benchmark/sample", "gateway": topic}
    samples = [b""]
    received: dict[str, queue.Queue[float]] = {name: queue.Queue() for name in targets}

    def arrival(name: str) -> Any:
        def on_message(message: Message) -> None:
            received[name].put(time.perf_counter())
            if name == "gateway":
                samples[0] = message.payload

        return on_message

    points = np.random.default_rng(0).random((POINTS, 3), np.float32)
    latencies_by_route: dict[str, list[float]] = {name: [] for name in targets}
    with Bus.open(endpoint, name="robot", wait_s=20.0) as robot, Bus.open(endpoint, name="client") as client:
        deadline_s = time.monotonic() + 60.0
        while not client.alive(keys.alive("mana", "gateway_ros2")):
            if time.monotonic() > deadline_s:
                raise TimeoutError("the gateway is not ready after 60 s")
        for name in ("raw", "sample"):
            client.subscribe(targets[name], arrival(name))
        client.subscribe(keys.sensor("mana", "lidar", "scan"), arrival("gateway"))
        time.sleep(1.0)
        start_cpu_s = 0.0
        for i in range(rounds + _WARM_UP):
            for name, key in targets.items():
                data = samples[0] if name == "sample" else cloud(types, points)
                attachment = rmw_zenoh.Attachment(i + 1, wall_ns(), bytes(16)).to_bytes()
                start_s = time.perf_counter()
                robot.publish(key, data, encoding=rmw_zenoh.ENCODING, attachment=attachment)
                end_s = received[name].get(timeout=TIMEOUT_S)
                if i == _WARM_UP - 1:
                    start_cpu_s = cpu_s(gateway_pid)
                if i >= _WARM_UP:
                    latencies_by_route[name].append(1e3 * (end_s - start_s))
        cpu_ms = 1e3 * (cpu_s(gateway_pid) - start_cpu_s) / rounds
        rates = {}
        for name, key in ((n, k) for n, k in targets.items() if n != "sample"):
            clouds = [cloud(types, points) for _ in range(_BURST)]
            rates[name] = rate_mb_per_s(robot, key, clouds, received[name])
    return latencies_by_route, cpu_ms, rates


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=200)
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        settings = Path(folder) / "gateway.yaml"
        settings.write_text(SETTINGS, encoding="utf-8")
        with Services(Path(folder), with_dpm=False) as services:
            command = [sys.executable, "-m", "services.gateway_ros2", "--settings", str(settings)]
            command += ["--connect", services.endpoint]
            with subprocess.Popen(command, stderr=subprocess.DEVNULL) as gateway:
                try:
                    latencies_by_route, cpu_ms, rates = latencies_ms(
                        services.endpoint, args.rounds, gateway.pid
                    )
                finally:
                    gateway.terminate()
    quantiles = {
        name: {"p50_ms": statistics.median(times), "p10_ms": float(np.quantile(times, 0.1))}
        for name, times in latencies_by_route.items()
    }
    report = {name: {q: round(v, 2) for q, v in of.items()} for name, of in quantiles.items()}
    for name, others in (("added", ("raw",)), ("alone", ("raw", "sample"))):
        report[name] = {
            q: round(quantiles["gateway"][q] - sum(quantiles[other][q] for other in others), 2)
            for q in ("p50_ms", "p10_ms")
        }
    mb_per_cpu_s = round(12e-6 * POINTS / (1e-3 * cpu_ms))
    report["gateway_cpu"] = {"ms": round(cpu_ms, 2), "mb_per_cpu_s": mb_per_cpu_s}
    report["mb_per_s"] = {name: round(rate) for name, rate in rates.items()}
    write_report({"rounds": args.rounds, **report, "load": round(os.getloadavg()[0], 1)}, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the orchestrator: latency of stored products, planning, simultaneous requests.

    python benchmarks/orchestrator.py [--calls 300] [--requests 1000] [--clients 50] [--out FILE]

The benchmark starts a router, a DPM and an orchestrator. ``raw``: a minimal process answers a Zenoh query
with the same bytes. ``by id``: the DPM returns the product by its id. ``request``: the orchestrator serves a
request by type, robot and age. Planning is measured in this process, with 100 DFPCs in layers, where each
input has three possible sources, and in a chain. Simultaneous requests are distributed over the clients; each
client has its own session and sends all its requests at once. A request answered OVERLOADED is repeated after
the stated time. CPU times are those of this process.
"""

from __future__ import annotations

import argparse
import os
import platform
import socket
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report

from cdff_common.bus import Bus, Reply, keys
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError, OverloadedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.orchestration.planner import Plan, plan
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)

ROOT = Path(__file__).resolve().parents[1]
PROFILE = """
name: benchmark
robots:
  - id: mana
    sensors:
      wheels: {kind: wheels, frame: mana/base, streams: {odometry: TransformWithCovariance}}
    dfpcs: []
"""
RAW = "cdff/benchmark/raw"
DEADLINE_S = 60.0


def free_endpoint() -> str:
    """Return an address on which no process listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def system(folder: Path) -> Iterator[str]:
    """Run router, DPM, orchestrator and the raw process; yield the endpoint of the router."""
    profile = folder / "profile.yaml"
    profile.write_text(PROFILE)
    endpoint = f"tcp/{free_endpoint()}"
    environment = {
        **os.environ,
        "CDFF_CONNECT": endpoint,
        "CDFF_DATA_DIR": str(folder),
        "OMP_NUM_THREADS": "1",
    }
    commands = [
        ["-m", "services.router", "--listen", endpoint],
        ["-m", "services.dpm", "--profile", str(profile), "--http", free_endpoint()],
        ["-m", "services.orchestrator", "--profile", str(profile)],
        [__file__, "--raw"],
    ]
    with (folder / "log").open("ab") as log:
        processes = [
            subprocess.Popen(
                [sys.executable, *c], env=environment, cwd=ROOT, stdin=subprocess.PIPE, stderr=log
            )
            for c in commands
        ]
    try:
        with Bus.open(endpoint, name="wait", wait_s=30) as bus:
            tokens = {keys.alive("mana", s) for s in ("dpm", "orchestrator")} | {keys.alive("ground", "raw")}
            deadline_s = time.monotonic() + 60
            while not tokens <= bus.alive(keys.alive("*", "*")):
                if time.monotonic() > deadline_s:
                    raise SystemExit(f"not ready: {(folder / 'log').read_text()[-2000:]}")
                time.sleep(0.1)
        yield endpoint
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(10)


def answer_raw() -> None:
    """Answer queries with the last stored payload of a name, until the process is killed."""
    with Bus.open(name="raw", wait_s=30) as bus:
        data: dict[str, bytes] = {}

        def on_query(request: Any) -> Reply:
            if request.payload:
                data[request.parameters["name"]] = bytes(request.payload)
                return Reply()
            return Reply(data[request.parameters["name"]])

        bus.serve(RAW, on_query)
        bus.declare_alive("ground", "raw")
        sys.stdin.read()


def values() -> dict[str, Any]:
    """Return a pose, and a cloud of about 700 kB."""
    stamp_ns = wall_ns() // 1000 * 1000
    T = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 0.0]), np.eye(6) * 1e-4)
    points = np.random.default_rng(1).uniform(-10, 10, (28_000, 3))
    return {
        "pose": TransformWithCovariance.from_transform(
            T, parent="site", child="mana/base", stamp_ns=stamp_ns
        ),
        "pointcloud": Pointcloud.from_points(points, frame="site", stamp_ns=stamp_ns),
    }


def store(bus: Bus, product: str, value: Any) -> str:
    """Store a value in the DPM and in the raw process; return its product id."""
    frame, child = ("site", "mana/base") if product == "pose" else ("site", None)
    identifier = product_id("mana", "bench", product, value.stamp_ns, 0, "")
    header = Header(
        identifier, 0, value.stamp_ns, value.stamp_ns, frame, "bench/B/1", child=child, box_m=value.extent_m()
    )
    data = encode(value, "uper")
    bus.call(
        keys.dpm_rpc("ground", "put"),
        {"robot": "mana", "dfpc": "bench", "port": product, "product": product},
        payload=data,
        encoding=encoding_string(type(value).__name__, "uper"),
        attachment=header.to_attachment(),
        timeout_s=30,
    )
    bus.call(RAW, {"name": product}, payload=data)
    return identifier


def spans_ms(call: Callable[[], object], count: int) -> dict[str, float]:
    """Return median and 99th percentile of the time of a call, milliseconds."""
    for _ in range(min(count, 20)):
        call()
    spans = []
    for _ in range(count):
        start = time.perf_counter()
        call()
        spans.append((time.perf_counter() - start) * 1e3)
    return {"p50_ms": statistics.median(spans), "p99_ms": float(np.percentile(spans, 99))}


def latencies(bus: Bus, product: str, value: Any, count: int) -> dict[str, Any]:
    """Return the latency of the same bytes for each of the three methods."""
    identifier = store(bus, product, value)
    parameters = {"type": product, "max_age_s": 3600, "deliver": "inline"}
    key = keys.orchestrator_rpc("mana", "request")
    methods: dict[str, Callable[[], Reply]] = {
        "raw": lambda: bus.call(RAW, {"name": product}),
        "by id": lambda: bus.call(keys.dpm_product("ground", identifier), {}, timeout_s=10),
        "request": lambda: bus.call(key, parameters, timeout_s=10),
    }
    sizes = {name: len(call().payload) for name, call in methods.items()}
    if len(set(sizes.values())) != 1:
        raise SystemExit(f"the methods differ in the size of their answers: {sizes}")
    figures: dict[str, Any] = {name: spans_ms(call, count) for name, call in methods.items()}
    figures["bytes"] = sizes["raw"]
    figures["over_raw_p50_ms"] = figures["request"]["p50_ms"] - figures["raw"]["p50_ms"]
    return figures


def layered_world(layers: int = 10, width: int = 10) -> World:
    """Return DFPCs in layers; three DFPCs of the previous layer, or the sensor, can provide the input of
    each.
    """
    providers = {}
    for layer in range(layers):
        for i in range(width):
            if layer == 0:
                sources: tuple[InputSource, ...] = (InputSource("sensor", "mana", "lidar", "scan"),)
            else:
                sources = tuple(
                    InputSource("product", "mana", f"d{layer - 1}_{(i + k) % width}", "out") for k in range(3)
                )
            provider = ProviderId("mana", f"d{layer}_{i}")
            product = "dem" if layer == layers - 1 else None
            providers[provider] = Provider(
                provider, {"out": product}, (Input("x", sources),), cost=1.0 + (layer * 7 + i * 3) % 5
            )
    sensor = SensorId("mana", "lidar")
    return World(providers, {sensor: SensorState(sensor, {"off": False, "on": True}, "off")})


def chain_world(count: int = 100) -> World:
    """Return a chain of DFPCs; each gets its input from the previous one."""
    base = layered_world(1, 1)
    providers = dict(base.providers)
    previous = next(iter(providers))
    for i in range(1, count):
        provider = ProviderId("mana", f"c{i}")
        source = InputSource("product", "mana", previous.dfpc, "out")
        providers[provider] = Provider(
            provider, {"out": "dem" if i == count - 1 else None}, (Input("x", (source,)),)
        )
        previous = provider
    first = ProviderId("mana", "d0_0")
    providers[first] = Provider(first, {"out": None}, providers[first].inputs)
    return World(providers, base.sensors)


def planning(count: int) -> dict[str, Any]:
    """Return the planning times in worlds of 100 DFPCs, milliseconds."""
    figures = {}
    for name, world in (("layers", layered_world()), ("chain", chain_world())):
        if not isinstance(plan(world, "dem", ["mana"]), Plan):
            raise SystemExit(f"no plan in the world {name}")
        spans = spans_ms(lambda w=world: plan(w, "dem", ["mana"]), count)
        start_s = time.process_time()
        for _ in range(count):
            plan(world, "dem", ["mana"])
        cpu_ms = (time.process_time() - start_s) / count * 1e3
        figures[name] = {"dfpcs": len(world.providers), **spans, "cpu_ms": cpu_ms}
    return figures


def simultaneous_requests(endpoint: str, requests: int, clients: int) -> dict[str, Any]:
    """Send many requests simultaneously; return how each ended, and the times including repetitions."""
    buses = [Bus.open(endpoint, name=f"client {i}", wait_s=30) for i in range(clients)]
    ended: Counter[str] = Counter()
    spans: list[float] = []
    overloaded_replies = [0]
    lock, key = threading.Lock(), keys.orchestrator_rpc("mana", "request")

    def send_request(i: int) -> None:
        bus, start, outcome = buses[i % clients], time.perf_counter(), ""
        deadline_ms = int(DEADLINE_S * 1000)
        parameters = {"type": "pose", "max_age_s": 3600, "deadline_ms": deadline_ms, "request": f"r{i}"}
        while not outcome:
            try:
                reply = bus.call(key, parameters, timeout_s=DEADLINE_S + 1)
                outcome = "answered" if reply.payload else "empty"
            except OverloadedError as error:
                with lock:
                    overloaded_replies[0] += 1
                if time.perf_counter() - start > DEADLINE_S:
                    outcome = "overloaded"
                time.sleep(min(error.retry_after_s, 1.0))
            except CdffError as error:
                outcome = type(error).__name__
        with lock:
            ended[outcome] += 1
            spans.append(time.perf_counter() - start)

    start, cpu_s = time.perf_counter(), time.process_time()
    try:
        with ThreadPoolExecutor(requests) as pool:
            list(pool.map(send_request, range(requests)))
    finally:
        for bus in buses:
            bus.close()
    return {
        "requests": requests,
        "clients": clients,
        "ended": dict(ended),
        "lost": requests - sum(ended.values()),
        "overloaded_replies": overloaded_replies[0],
        "p50_s": statistics.median(spans),
        "p99_s": float(np.percentile(spans, 99)),
        "wall_s": time.perf_counter() - start,
        "client_cpu_s": time.process_time() - cpu_s,
    }


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--calls", type=int, default=300)
    parser.add_argument("--requests", type=int, default=1000)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--raw", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.raw:
        answer_raw()
        return
    figures: dict[str, Any] = {"about": {"python": platform.python_version(), "cpus": os.cpu_count()}}
    figures["planning"] = planning(max(args.calls // 3, 1))
    with tempfile.TemporaryDirectory() as folder, system(Path(folder)) as endpoint:
        with Bus.open(endpoint, name="benchmark", wait_s=30) as bus:
            figures["served"] = {
                name: latencies(bus, name, value, args.calls) for name, value in values().items()
            }
        figures["at_once"] = simultaneous_requests(endpoint, args.requests, args.clients)
    write_report(figures, args.out)


if __name__ == "__main__":
    main()

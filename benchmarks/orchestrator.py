# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The orchestrator: what an answer from the store costs over a raw query, planning, and many requests at once.

    python benchmarks/orchestrator.py [--calls 300] [--requests 1000] [--clients 50] [--out FILE]

Starts a router, a DPM and an orchestrator of its own. ``raw`` is a Zenoh query that a bare process answers with the
same bytes; ``by id`` the DPM asked for them by their id; ``request`` the orchestrator asked by type, robot and age.
Planning is timed in this process, on 100 DFPCs in layers where each input can be fed by three others, and in a chain.
The requests at once are shared out over the clients, each with a session of its own and all of its requests under way
at a time; one told OVERLOADED asks again after the time it is told. CPU times are this process's.
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
from _report import give_out

from cdff_common.bus import Bus, Reply, keys
from cdff_common.clock import wall_ns
from cdff_common.codecs import encode
from cdff_common.codecs.encoding import encoding_string
from cdff_common.errors import CdffError, OverloadedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.orchestration.planner import Plan, plan
from cdff_core.orchestration.world import Input, Maker, MakerId, SensorId, SensorState, Source, World

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
    """An address nobody listens on now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def system(folder: Path) -> Iterator[str]:
    """Router, DPM, orchestrator and the raw answerer; the endpoint."""
    profile = folder / "profile.yaml"
    profile.write_text(PROFILE)
    endpoint = f"tcp/{free_endpoint()}"
    environment = {**os.environ, "CDFF_CONNECT": endpoint, "CDFF_DATA_DIR": str(folder), "OMP_NUM_THREADS": "1"}
    commands = [
        ["-m", "services.router", "--listen", endpoint],
        ["-m", "services.dpm", "--profile", str(profile), "--http", free_endpoint()],
        ["-m", "services.orchestrator", "--profile", str(profile)],
        [__file__, "--raw"],
    ]
    with (folder / "log").open("ab") as log:
        processes = [
            subprocess.Popen([sys.executable, *c], env=environment, cwd=ROOT, stdin=subprocess.PIPE, stderr=log)
            for c in commands
        ]
    try:
        with Bus.open(endpoint, name="wait", wait_s=30) as bus:
            wanted = {keys.alive("mana", s) for s in ("dpm", "orchestrator")} | {keys.alive("ground", "raw")}
            until_s = time.monotonic() + 60
            while not wanted <= bus.alive(keys.alive("*", "*")):
                if time.monotonic() > until_s:
                    raise SystemExit(f"not ready: {(folder / 'log').read_text()[-2000:]}")
                time.sleep(0.1)
        yield endpoint
    finally:
        for process in reversed(processes):
            process.terminate()
        for process in processes:
            process.wait(10)


def answer_raw() -> None:
    """Answer what was last put, until killed."""
    with Bus.open(name="raw", wait_s=30) as bus:
        data: dict[str, bytes] = {}

        def take(request: Any) -> Reply:
            if request.payload:
                data[request.parameters["name"]] = bytes(request.payload)
                return Reply()
            return Reply(data[request.parameters["name"]])

        bus.serve(RAW, take)
        bus.declare_alive("ground", "raw")
        sys.stdin.read()


def values() -> dict[str, Any]:
    """A pose, and a cloud of about 700 kB."""
    stamp_ns = wall_ns() // 1000 * 1000
    T = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 0.0]), np.eye(6) * 1e-4)
    points = np.random.default_rng(1).uniform(-10, 10, (28_000, 3))
    return {
        "pose": TransformWithCovariance.from_transform(T, parent="site", child="mana/base", stamp_ns=stamp_ns),
        "pointcloud": Pointcloud.from_points(points, frame="site", stamp_ns=stamp_ns),
    }


def store(bus: Bus, product: str, value: Any) -> str:
    """Put a value into the DPM and with the raw answerer; its id."""
    frame, child = ("site", "mana/base") if product == "pose" else ("site", None)
    made = product_id("mana", "bench", product, value.stamp_ns, 0, "")
    header = Header(made, 0, value.stamp_ns, value.stamp_ns, frame, "bench/B/1", child=child, box_m=value.extent_m())
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
    return made


def spans_ms(call: Callable[[], object], count: int) -> dict[str, float]:
    """Median and 99th percentile of a call, milliseconds."""
    for _ in range(min(count, 20)):
        call()
    spans = []
    for _ in range(count):
        start = time.perf_counter()
        call()
        spans.append((time.perf_counter() - start) * 1e3)
    return {"p50_ms": statistics.median(spans), "p99_ms": float(np.percentile(spans, 99))}


def served(bus: Bus, product: str, value: Any, count: int) -> dict[str, Any]:
    """The same bytes by the three ways."""
    made = store(bus, product, value)
    asked = {"type": product, "max_age_s": 3600, "deliver": "inline"}
    key = keys.orchestrator_rpc("mana", "request")
    ways: dict[str, Callable[[], Reply]] = {
        "raw": lambda: bus.call(RAW, {"name": product}),
        "by id": lambda: bus.call(keys.dpm_product("ground", made), {}, timeout_s=10),
        "request": lambda: bus.call(key, asked, timeout_s=10),
    }
    sizes = {name: len(call().payload) for name, call in ways.items()}
    if len(set(sizes.values())) != 1:
        raise SystemExit(f"the ways differ in what they bring: {sizes}")
    figures: dict[str, Any] = {name: spans_ms(call, count) for name, call in ways.items()}
    figures["bytes"] = sizes["raw"]
    figures["over_raw_p50_ms"] = figures["request"]["p50_ms"] - figures["raw"]["p50_ms"]
    return figures


def layered_world(layers: int = 10, width: int = 10) -> World:
    """DFPCs in layers; each has one input that three of the layer before, or the sensor, can feed."""
    makers = {}
    for layer in range(layers):
        for i in range(width):
            if layer == 0:
                sources: tuple[Source, ...] = (Source("sensor", "mana", "lidar", "scan"),)
            else:
                sources = tuple(Source("product", "mana", f"d{layer - 1}_{(i + k) % width}", "out") for k in range(3))
            made = MakerId("mana", f"d{layer}_{i}")
            product = "dem" if layer == layers - 1 else None
            makers[made] = Maker(made, {"out": product}, (Input("x", sources),), cost=1.0 + (layer * 7 + i * 3) % 5)
    sensor = SensorId("mana", "lidar")
    return World(makers, {sensor: SensorState(sensor, {"off": False, "on": True}, "off")})


def chain_world(count: int = 100) -> World:
    """DFPCs each of which is fed by the one before."""
    base = layered_world(1, 1)
    makers = dict(base.makers)
    before = next(iter(makers))
    for i in range(1, count):
        made = MakerId("mana", f"c{i}")
        source = Source("product", "mana", before.dfpc, "out")
        makers[made] = Maker(made, {"out": "dem" if i == count - 1 else None}, (Input("x", (source,)),))
        before = made
    first = MakerId("mana", "d0_0")
    makers[first] = Maker(first, {"out": None}, makers[first].inputs)
    return World(makers, base.sensors)


def planning(count: int) -> dict[str, Any]:
    """Milliseconds to plan in worlds of 100 DFPCs."""
    figures = {}
    for name, world in (("layers", layered_world()), ("chain", chain_world())):
        if not isinstance(plan(world, "dem", ["mana"]), Plan):
            raise SystemExit(f"no plan in the world {name}")
        spans = spans_ms(lambda w=world: plan(w, "dem", ["mana"]), count)
        start_s = time.process_time()
        for _ in range(count):
            plan(world, "dem", ["mana"])
        cpu_ms = (time.process_time() - start_s) / count * 1e3
        figures[name] = {"dfpcs": len(world.makers), **spans, "cpu_ms": cpu_ms}
    return figures


def at_once(endpoint: str, requests: int, clients: int) -> dict[str, Any]:
    """Many requests at a time: what became of each, and how long it took with the times of coming back."""
    buses = [Bus.open(endpoint, name=f"client {i}", wait_s=30) for i in range(clients)]
    ended: Counter[str] = Counter()
    spans: list[float] = []
    told_overloaded = [0]
    lock, key = threading.Lock(), keys.orchestrator_rpc("mana", "request")

    def ask(i: int) -> None:
        bus, start, how = buses[i % clients], time.perf_counter(), ""
        asked = {"type": "pose", "max_age_s": 3600, "deadline_ms": int(DEADLINE_S * 1000), "request": f"r{i}"}
        while not how:
            try:
                how = "answered" if bus.call(key, asked, timeout_s=DEADLINE_S + 1).payload else "empty"
            except OverloadedError as error:
                with lock:
                    told_overloaded[0] += 1
                if time.perf_counter() - start > DEADLINE_S:
                    how = "overloaded"
                time.sleep(min(error.retry_after_s, 1.0))
            except CdffError as error:
                how = type(error).__name__
        with lock:
            ended[how] += 1
            spans.append(time.perf_counter() - start)

    start, cpu_s = time.perf_counter(), time.process_time()
    try:
        with ThreadPoolExecutor(requests) as pool:
            list(pool.map(ask, range(requests)))
    finally:
        for bus in buses:
            bus.close()
    return {
        "requests": requests,
        "clients": clients,
        "ended": dict(ended),
        "lost": requests - sum(ended.values()),
        "told_overloaded": told_overloaded[0],
        "p50_s": statistics.median(spans),
        "p99_s": float(np.percentile(spans, 99)),
        "wall_s": time.perf_counter() - start,
        "client_cpu_s": time.process_time() - cpu_s,
    }


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
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
            figures["served"] = {name: served(bus, name, value, args.calls) for name, value in values().items()}
        figures["at_once"] = at_once(endpoint, args.requests, args.clients)
    give_out(figures, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure the orchestrator: latency of stored products, planning, simultaneous requests.

    python benchmarks/orchestrator.py [--calls 300] [--requests 1000] [--clients 50] [--out FILE]
        [--only PART ...] [--standing 10 50 200 500 2000] [--robots 1 10 100] [--fleet 50] [--duration-s 30]

The benchmark starts a router, a DPM and an orchestrator. ``raw``: a minimal process answers a Zenoh query
with the same bytes. ``by id``: the DPM returns the product by its id. ``request``: the orchestrator serves a
request by type, robot and age. Planning is measured in this process, with 100 DFPCs in layers, where each
input has three possible sources, and in a chain. Simultaneous requests are distributed over the clients; each
client has its own session and sends all its requests at once. A request answered OVERLOADED is repeated after
the stated time. CPU times are those of this process.

``fleet``: for each number of robots, the CPU time in this process to describe all DFPCs, to list the
catalogue, to plan one request and to determine the due actions. ``standing``: standing requests for poses
of ``--fleet`` robots with a period of ``--every-s``, with stand-in hosts that store a pose of each robot at
the same rate in the DPM. Each row has the fraction delivered of the poses that were captured between sending
and end of a request, the time until the first one, their lateness (reception after the later of the capture
and the end of the period), the number of requests with exactly one final reply, and of the processes the CPU
time, the memory (before, at the end, and 20 s later) and the threads.

``idle``: CPU time per second of all processes of two rovers without a request, and their memory.
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
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml
import zenoh
from _fleet import fleet_profile
from _report import write_report
from _services import cpu_s, memory_mb, threads

from cdff_common.bus import Bus, Reply, keys
from cdff_common.bus.message import unpack
from cdff_common.bus.session import open_client
from cdff_common.clock import WallClock, wall_ns
from cdff_common.codecs import encode, encoding_string
from cdff_common.errors import CdffError, OverloadedError
from cdff_common.geometry import UncertainTransform, se3
from cdff_common.interfaces.product import Header, product_id
from cdff_common.interfaces.profile import load_profile
from cdff_common.resources import deploy_folder
from cdff_common.types import Pointcloud, TransformWithCovariance
from cdff_core.orchestration.planner import Plan, plan
from cdff_core.orchestration.request import parse_request
from cdff_core.orchestration.world import (
    Input,
    InputSource,
    Provider,
    ProviderId,
    SensorId,
    SensorState,
    World,
)
from cdff_dev.missions.stage import Stage
from services.orchestrator.planning import RequestPlanner
from services.orchestrator.product_finder import ProductFinder
from services.orchestrator.state import SystemState

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
#: Time in which processes return freed memory, seconds.
SETTLED_S = 20.0


def free_endpoint() -> str:
    """Return an address on which no process listens now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"127.0.0.1:{probe.getsockname()[1]}"


@dataclass(frozen=True)
class System:
    """A running system: endpoint of its router, and its processes."""

    endpoint: str
    processes: Mapping[str, subprocess.Popen[bytes]]


@contextmanager
def system(
    folder: Path,
    profile: Path,
    other: Sequence[str],
    token: tuple[str, str],
    robot: str,
    options: Sequence[str] = (),
) -> Iterator[System]:
    """Run router, DPM, orchestrator and another process with a ``token``, and yield them once ready.

    ``options`` are those of the orchestrator, ``robot`` is one of the profile.
    """
    endpoint = f"tcp/{free_endpoint()}"
    environment = {
        **os.environ,
        "CDFF_CONNECT": endpoint,
        "CDFF_DATA_DIR": str(folder),
        "OMP_NUM_THREADS": "1",
    }
    commands: dict[str, Sequence[str]] = {
        "router": ["-m", "services.router", "--listen", endpoint],
        "dpm": ["-m", "services.dpm", "--profile", str(profile), "--http", free_endpoint()],
        "orchestrator": ["-m", "services.orchestrator", "--profile", str(profile), *options],
        "other": other,
    }
    with (folder / "log").open("ab") as log:
        processes = {
            name: subprocess.Popen(
                [sys.executable, *c], env=environment, cwd=ROOT, stdin=subprocess.PIPE, stderr=log
            )
            for name, c in commands.items()
        }
    try:
        with Bus.open(endpoint, name="wait", wait_s=30) as bus:
            tokens = {keys.alive(robot, s) for s in ("dpm", "orchestrator")} | {keys.alive(*token)}
            deadline_s = time.monotonic() + 180
            while not tokens <= bus.alive(keys.alive("*", "*")):
                if time.monotonic() > deadline_s:
                    raise SystemExit(f"not ready: {(folder / 'log').read_text()[-2000:]}")
                time.sleep(0.1)
        yield System(endpoint, processes)
    finally:
        for process in reversed(processes.values()):
            process.terminate()
        for process in processes.values():
            process.wait(30)


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


def fleet(robots: int) -> dict[str, Any]:
    """Return the CPU time of operations of the orchestrator on a fleet, measured in this process."""
    profile = fleet_profile(robots)
    state = SystemState(profile)
    planner = RequestPlanner(state, ProductFinder(None, WallClock(), lambda: profile), WallClock())
    request = parse_request({"type": "pose", "every_s": "1"}, "r0")
    descriptions = {p: dict(d) for p, d in state._descriptions.items()}

    def describe() -> None:
        for provider, description in descriptions.items():
            state.set_description(provider, description)
            state.set_state(provider, "inactive")
            state.set_alive(provider, alive=True)
            state.actions()

    def plan_request() -> None:
        for i in range(20):
            selected, _ = planner.best(request, ["r0"], None, frozenset(), 0.0, 10.0, f"job {i}")
            state.hold(f"job {i}", selected, 5)
        for i in range(20):
            state.release(f"job {i}")

    figures: dict[str, Any] = {"robots": robots, "dfpcs": len(descriptions)}
    figures["describe_all_cpu_s"] = cpu_of(describe, 1)
    figures["plan_hold_release_cpu_ms"] = cpu_of(plan_request, 1) / 20 * 1e3
    figures["catalogue_cpu_ms"] = cpu_of(lambda: state.catalogue(profile.robot_ids), 1) * 1e3
    figures["actions_cpu_ms"] = cpu_of(state.actions, 5) * 1e3
    return figures


def cpu_of(call: Callable[[], object], count: int) -> float:
    """Return the mean CPU time of a call in this process, seconds."""
    start_s = time.process_time()
    for _ in range(count):
        call()
    return round((time.process_time() - start_s) / count, 6)


class StandingRequest:
    """A standing request, and the times of its replies."""

    def __init__(self, session: zenoh.Session, robot: str, every_s: float, duration_s: float, i: int) -> None:
        self.robot, self.every_s = robot, every_s
        self.late_s: list[float] = []
        self.products = self.finals = 0
        self.outcome = ""
        self.sent_s = wall_ns() * 1e-9
        self.end_s = self.sent_s + duration_s
        self.first_s: float | None = None
        self._received_s = float("-inf")
        parameters = {"type": "pose", "every_s": every_s, "deadline_ms": int(duration_s * 1e3)}
        selector = f"{keys.orchestrator_rpc(robot, 'request')}?" + ";".join(
            f"{name}={value}" for name, value in {**parameters, "request": f"s{i}"}.items()
        )
        session.get(
            selector,
            zenoh.handlers.Callback(self._on_reply, indirect=False),
            timeout=duration_s + 30.0,
            consolidation=zenoh.ConsolidationMode.NONE,
        )

    def _on_reply(self, reply: zenoh.Reply) -> None:
        if reply.ok is None:
            self.finals += 1
            self.outcome = str(unpack(reply.err.payload.to_bytes()).get("code", "timeout"))
            return
        attachment = unpack(reply.ok.attachment.to_bytes())
        if attachment["kind"] == "product":
            now_s = wall_ns() * 1e-9
            due_s = max(attachment["t1_ns"] * 1e-9, self._received_s + self.every_s)
            self.late_s.append(now_s - due_s)
            self._received_s, self.products = now_s, self.products + 1
            if self.first_s is None:
                self.first_s = now_s - self.sent_s
        if attachment["final"]:
            self.finals += 1
            self.outcome = str(attachment["kind"])


def standing(requests: int, robots: int, every_s: float, duration_s: float) -> dict[str, Any]:
    """Return the figures of some standing requests over the robots of a fleet."""
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        profile = folder / "profile.yaml"
        profile.write_text(
            yaml.safe_dump(fleet_profile(robots).model_dump(mode="json", exclude_defaults=True))
        )
        hosts = [
            str(ROOT / "benchmarks" / "_fleet.py"),
            "--profile",
            str(profile),
            "--rate-hz",
            f"{1 / every_s}",
        ]
        capacity = ("--capacity", str(requests + 1))
        with system(folder, profile, hosts, ("ground", "hosts"), "r0", capacity) as running:
            time.sleep(10.0)  # all hosts are described
            return {"requests": requests, "robots": robots, "every_s": every_s} | run_standing(
                running, requests, robots, every_s, duration_s
            )


def run_standing(
    running: System, requests: int, robots: int, every_s: float, duration_s: float
) -> dict[str, Any]:
    """Send standing requests to a running system; return how they were served."""
    pids = {name: p.pid for name, p in running.processes.items()}
    sessions = [open_client(running.endpoint, 30.0) for _ in range(min(10, requests))]
    before_s = {name: cpu_s(pid) for name, pid in pids.items()}
    memory_before_mb = {name: memory_mb(pid) for name, pid in pids.items()}
    open_requests = [
        StandingRequest(sessions[i % len(sessions)], f"r{i % robots}", every_s, duration_s, i)
        for i in range(requests)
    ]
    peak_threads: Counter[str] = Counter()
    until_s = time.monotonic() + duration_s + 35.0
    while time.monotonic() < until_s and not all(r.finals for r in open_requests):
        time.sleep(0.5)
        peak_threads |= Counter({name: threads(pid) for name, pid in pids.items()})
    time.sleep(1.0)
    memory_mb_at_end = {name: memory_mb(pid) for name, pid in pids.items()}
    time.sleep(SETTLED_S)
    late_s = [s for r in open_requests for s in r.late_s]
    with Bus.open(running.endpoint, name="count", wait_s=30) as bus:
        stored_s = {r.robot: stored_stamps_s(bus, r.robot) for r in open_requests[:robots]}
    due = sum(sum(r.sent_s <= s < r.end_s for s in stored_s[r.robot]) for r in open_requests)
    first_s = [duration_s if r.first_s is None else r.first_s for r in open_requests]
    figures = {
        "products_fraction": sum(r.products for r in open_requests) / max(due, 1),
        "first_p50_s": statistics.median(first_s),
        "first_p95_s": float(np.percentile(first_s, 95)),
        "late_p50_s": statistics.median(late_s) if late_s else None,
        "late_p95_s": float(np.percentile(late_s, 95)) if late_s else None,
        "exactly_one_final": sum(r.finals == 1 for r in open_requests),
        "ended": dict(Counter(r.outcome for r in open_requests)),
        "cpu_s": {name: round(cpu_s(pid) - before_s[name], 2) for name, pid in pids.items()},
        "memory_mb": {
            name: [memory_before_mb[name], memory_mb_at_end[name], memory_mb(pid)]
            for name, pid in pids.items()
        },
        "threads": dict(peak_threads),
    }
    for session in sessions:
        session.close()
    return figures


def idle(duration_s: float) -> dict[str, Any]:
    """Return the CPU time and the memory of a system of two rovers without a request and without samples."""
    path = deploy_folder() / "profiles" / "two_rovers.yaml"
    connect, http = f"tcp/{free_endpoint()}", free_endpoint()
    with (
        Stage(load_profile(path), path, connect, http) as stage,
        Bus.open(connect, name="wait", wait_s=60) as bus,
    ):
        stage.wait_ready(bus)
        time.sleep(SETTLED_S)
        processes = psutil.Process(stage.supervisor_pid).children(recursive=True)
        processes.append(psutil.Process(stage.supervisor_pid))
        before_s = [sum(p.cpu_times()[:2]) for p in processes]
        time.sleep(duration_s)
        used_s = [
            sum(p.cpu_times()[:2]) - start_cpu_s for p, start_cpu_s in zip(processes, before_s, strict=True)
        ]
        names = [" ".join(p.cmdline()[2:6]) for p in processes]
        return {
            "processes": len(processes),
            "cpu_fraction_of_one_core": sum(used_s) / duration_s,
            "cpu_ms_per_s": {
                name: round(1e3 * start_cpu_s / duration_s, 2)
                for name, start_cpu_s in zip(names, used_s, strict=True)
            },
            "memory_mb": {
                name: round(p.memory_info().rss / 1e6, 1) for name, p in zip(names, processes, strict=True)
            },
        }


def stored_stamps_s(bus: Bus, robot: str) -> list[float]:
    """Return the capture times of the poses of a robot in the DPM, seconds."""
    parameters = {"type": "pose", "robot": robot, "limit": 1000}
    items = bus.call(keys.dpm_rpc("ground", "search"), parameters, timeout_s=30).body()["items"]
    return [item["t1_ns"] * 1e-9 for item in items]


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--calls", type=int, default=300)
    parser.add_argument("--requests", type=int, default=1000)
    parser.add_argument("--clients", type=int, default=50)
    parts = ("planning", "served", "fleet", "standing", "idle")
    parser.add_argument("--only", nargs="+", choices=parts, default=parts)
    parser.add_argument("--standing", nargs="+", type=int, default=(10, 50, 200, 500, 2000))
    parser.add_argument("--robots", nargs="+", type=int, default=(1, 10, 100))
    parser.add_argument("--fleet", type=int, default=50)
    parser.add_argument("--every-s", type=float, default=1.0)
    parser.add_argument("--duration-s", type=float, default=30.0)
    parser.add_argument("--out", type=Path, default=None)
    parser.add_argument("--raw", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.raw:
        answer_raw()
        return
    figures: dict[str, Any] = {"about": {"python": platform.python_version(), "cpus": os.cpu_count()}}
    if "planning" in args.only:
        figures["planning"] = planning(max(args.calls // 3, 1))
    if "served" in args.only:
        figures |= served(args.calls, args.requests, args.clients)
    if "fleet" in args.only:
        figures["fleet"] = [fleet(robots) for robots in args.robots]
    if "idle" in args.only:
        figures["idle"] = idle(args.duration_s)
    if "standing" in args.only:
        figures["standing"] = [
            standing(requests, args.fleet, args.every_s, args.duration_s) for requests in args.standing
        ]
    write_report(figures, args.out)


def served(calls: int, requests: int, clients: int) -> dict[str, Any]:
    """Return the latency of stored products, and the times of simultaneous requests."""
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        profile = folder / "profile.yaml"
        profile.write_text(PROFILE)
        with system(folder, profile, [__file__, "--raw"], ("ground", "raw"), "mana") as running:
            with Bus.open(running.endpoint, name="benchmark", wait_s=30) as bus:
                figures = {name: latencies(bus, name, value, calls) for name, value in values().items()}
            at_once = simultaneous_requests(running.endpoint, requests, clients)
    return {"served": figures, "at_once": at_once}


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Capacity of one ground for many robots: coefficients, a model, and its check with stand-in robots.

    python benchmarks/capacity.py [--robots N] [--seconds S] [--calls K] [--out FILE]

``coefficients``: CPU time of router, DPM and orchestrator for a heartbeat, a stored pose, a stored
megabyte, a search and a request, each by ``--calls`` calls to a system of ten robots, less the CPU time
of the idle system. ``model``: CPU time and rates for 1, 10, 100 and 1 000 robots with the activity
``ROBOT``, and the number of robots at which each process uses ``_USABLE`` of one core, or the disk is full
after ``DISK_DAYS``. ``check``: the same system with ``--robots`` stand-in robots (``benchmarks/_fleet.py``)
that send what ``ROBOT`` states, compared with the model; ``failures`` counts the requests, searches and
insertions that failed.
"""

from __future__ import annotations

import argparse
import os
import statistics
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]

from _fleet import fleet_profile  # noqa: E402
from _report import write_report  # noqa: E402
from _services import cpu_s, memory_mb  # noqa: E402
from orchestrator import System, system  # noqa: E402

from cdff_common.bus import Bus, keys  # noqa: E402
from cdff_common.clock import wall_ns  # noqa: E402
from cdff_common.codecs import encode, encoding_string  # noqa: E402
from cdff_common.errors import CdffError  # noqa: E402
from cdff_common.geometry import UncertainTransform, se3  # noqa: E402
from cdff_common.interfaces.product import Header, product_id  # noqa: E402
from cdff_common.types import Pointcloud, TransformWithCovariance  # noqa: E402

PROCESSES = ("router", "dpm", "orchestrator")
#: Activity of one robot per second: heartbeats of its DFPCs, stored poses, megabytes of clouds and maps,
#: searches of operators, requests of its autonomy framework.
ROBOT = {"heartbeat": 7.0, "pose": 1.0, "megabyte": 0.02, "search": 0.02, "request": 0.1}
#: Assumed prices of a core for an hour, and of a stored gigabyte for a month, in one currency.
PRICE_CORE_H, PRICE_GB_MONTH = 0.04, 0.02
#: Size of a disk, GB, and the time in which it may become full, days.
DISK_GB, DISK_DAYS = 1000.0, 7.0
#: Fraction of one core that a process in Python can use before its answers are late.
_USABLE = 0.7
_SIZES = (1, 10, 100, 1000)
_FLEET = Path(__file__).with_name("_fleet.py")
_CLOUD_POINTS = 80_000
#: Assumed size of a message without its payload, MB.
_MESSAGE_MB = 0.0005
#: Requests that are sent at the same time by the clients of the stand-in robots.
_CLIENTS = 30


@contextmanager
def running(robots: int, rate_hz: float) -> Iterator[tuple[System, Bus]]:
    """Run router, DPM, orchestrator and stand-in hosts of some robots."""
    with tempfile.TemporaryDirectory() as name:
        profile = Path(name) / "profile.yaml"
        fleet = fleet_profile(robots).model_dump(mode="json", exclude_defaults=True)
        profile.write_text(yaml.safe_dump(fleet))
        other = [str(_FLEET), "--profile", str(profile), "--rate-hz", str(rate_hz)]
        with (
            system(Path(name), profile, other, ("ground", "hosts"), "r0") as started,
            Bus.open(started.endpoint, name="benchmark", wait_s=30) as bus,
        ):
            time.sleep(5.0)
            yield started, bus


def cpu(started: System) -> dict[str, float]:
    """Return the CPU seconds of each process."""
    return {name: cpu_s(started.processes[name].pid) for name in PROCESSES}


def rate_of(started: System, seconds: float) -> dict[str, float]:
    """Return the CPU seconds per second of each process."""
    before, start_s = cpu(started), time.monotonic()
    time.sleep(seconds)
    elapsed_s, after = time.monotonic() - start_s, cpu(started)
    return {name: (after[name] - before[name]) / elapsed_s for name in PROCESSES}


class Calls:
    """One call of each kind."""

    def __init__(self, bus: Bus) -> None:
        self._bus = bus
        rng = np.random.default_rng(1)
        points = rng.uniform(-20.0, 20.0, (_CLOUD_POINTS, 3))
        self._cloud = encode(
            Pointcloud.from_points(points, frame="r0/base", stamp_ns=wall_ns() // 1000 * 1000), "uper"
        )

    def heartbeat(self, k: int) -> None:
        """Publish the status of a DFPC that has the states of the stand-in hosts."""
        body = {"state": "inactive", "changes": 0, "samples": k, "rss_mb": 50.0, "samples_by_port": {}}
        body |= {"outputs": 0, "failed": 0, "mean_step_cpu_s": 0.001, "last_step_s": 0.001}
        self._bus.publish_map(keys.dfpc_status(f"r{k % 10}", "lidar_slam"), body)
        time.sleep(0.001)

    def pose(self, k: int) -> None:
        """Store a pose."""
        stamp_ns, robot = wall_ns() // 1000 * 1000, f"r{k % 10}"
        T = UncertainTransform(se3.transform(np.eye(3), [1.0, 2.0, 0.0]), np.eye(6) * 1e-4)
        value = TransformWithCovariance.from_transform(
            T, parent="site", child=f"{robot}/base", stamp_ns=stamp_ns
        )
        self._put(
            robot, "position_manager", "pose", value, stamp_ns, encode(value, "uper"), f"{robot}/base", k
        )

    def megabyte(self, k: int) -> None:
        """Store a cloud; its size is that of ``cloud_mb``."""
        stamp_ns = wall_ns() // 1000 * 1000
        self._put("r0", "lidar_slam", "pointcloud", None, stamp_ns, self._cloud, None, k)

    @property
    def cloud_mb(self) -> float:
        """Size of the cloud, MB."""
        return len(self._cloud) / 1e6

    def search(self, k: int) -> None:
        """Search the newest poses of a robot."""
        query = {"robot": f"r{k % 10}", "type": "pose", "limit": 20}
        self._bus.call(keys.dpm_rpc("ground", "search"), query, timeout_s=30)

    def request(self, k: int) -> None:
        """Request a stored pose."""
        query = {"type": "pose", "robot": f"r{k % 10}", "max_age_s": 600, "deadline_ms": 20_000}
        self._bus.call(keys.orchestrator_rpc("ground", "request"), query, timeout_s=21)

    def _put(
        self,
        robot: str,
        dfpc: str,
        port: str,
        value: Any,
        stamp_ns: int,
        data: bytes,
        child: str | None,
        k: int,
    ) -> None:
        name = product_id(robot, dfpc, port, stamp_ns, k, "")
        frame = "site" if value is not None else f"{robot}/base"
        header = Header(name, k, stamp_ns, stamp_ns, frame, "fleet/A/1", child=child)
        type_name = "Pointcloud" if value is None else "TransformWithCovariance"
        self._bus.call(
            keys.dpm_rpc("ground", "put"),
            {"robot": robot, "dfpc": dfpc, "port": port, "product": port},
            payload=data,
            encoding=encoding_string(type_name, "uper"),
            attachment=header.to_attachment(),
            timeout_s=60,
        )


def coefficients(calls: int) -> dict[str, Any]:
    """Return CPU milliseconds of each process and wall milliseconds, for one call of each kind."""
    figures: dict[str, Any] = {}
    with running(10, 0.01) as (started, bus):
        made = Calls(bus)
        kinds: dict[str, tuple[Callable[[int], None], int, float]] = {
            "heartbeat": (made.heartbeat, 5 * calls, 1.0),
            "pose": (made.pose, calls, 1.0),
            "megabyte": (made.megabyte, max(calls // 20, 5), made.cloud_mb),
            "search": (made.search, calls, 1.0),
            "request": (made.request, calls, 1.0),
        }
        for k in range(10):  # a pose of each robot to search and to request
            made.pose(k)
        idle = rate_of(started, 10.0)
        for kind, (call, count, units) in kinds.items():
            before, start_s, spans = cpu(started), time.monotonic(), []
            for k in range(count):
                call_s = time.perf_counter()
                call(k)
                spans.append(time.perf_counter() - call_s)
            time.sleep(1.0)
            elapsed_s, after = time.monotonic() - start_s, cpu(started)
            figures[kind] = {
                name: round(1e3 * (after[name] - before[name] - idle[name] * elapsed_s) / count / units, 4)
                for name in PROCESSES
            }
            figures[kind]["wall_p50_ms"] = round(1e3 * statistics.median(spans) / units, 3)
    return {"idle": idle, "cloud_mb": made.cloud_mb, "per_call_ms": figures}


def predicted(measured: dict[str, Any], robots: int) -> dict[str, float]:
    """Return the CPU seconds per second of each process with a number of robots."""
    per_call = measured["per_call_ms"]
    return {
        name: measured["idle"][name] + robots * sum(ROBOT[k] * per_call[k][name] / 1e3 for k in ROBOT)
        for name in PROCESSES
    }


def model(measured: dict[str, Any]) -> dict[str, Any]:
    """Return rates and CPU for each size, and the number of robots at which each process is saturated."""
    calls = ("pose", "search", "request")
    messages = ROBOT["heartbeat"] + 2.0 * sum(ROBOT[k] for k in calls) + ROBOT["megabyte"]
    rows = {}
    for robots in _SIZES:
        load = predicted(measured, robots)
        rows[str(robots)] = {
            "messages_per_s": round(robots * messages, 1),
            "megabytes_per_s": round(robots * (ROBOT["megabyte"] + _MESSAGE_MB * messages), 3),
            "gigabytes_per_day": round(robots * ROBOT["megabyte"] * 86.4, 2),
            "searches_per_s": round(robots * ROBOT["search"], 2),
            "insertions_per_s": round(robots * (ROBOT["pose"] + ROBOT["megabyte"] / measured["cloud_mb"]), 2),
            "cpu": {name: round(value, 3) for name, value in load.items()},
            "cores": round(sum(load.values()), 2),
            "price_per_month": round(
                720.0 * sum(load.values()) * PRICE_CORE_H
                + 30.0 * robots * ROBOT["megabyte"] * 86.4 * PRICE_GB_MONTH
            ),
        }
    saturated = {}
    for name in PROCESSES:
        each = predicted(measured, 1)[name] - measured["idle"][name]
        saturated[name] = round((_USABLE - measured["idle"][name]) / max(each, 1e-9))
    disk = round(DISK_GB / DISK_DAYS / (86.4 * ROBOT["megabyte"]))
    limits = saturated | {f"disk of {DISK_GB:g} GB in {DISK_DAYS:g} days": disk}
    return {"robots": rows, "robots_at_limit": limits, "first": min(limits, key=limits.__getitem__)}


def check(measured: dict[str, Any], robots: int, seconds: float) -> dict[str, Any]:
    """Run stand-in robots with the activity ``ROBOT``; compare the CPU time with the model at their rates."""
    spans: list[float] = []
    failures: Counter[str] = Counter()
    with running(robots, ROBOT["pose"]) as (started, bus), ThreadPoolExecutor(_CLIENTS) as pool:
        made = Calls(bus)

        def attempt(call: Callable[[int], None], k: int) -> None:
            try:
                call(k)
            except CdffError as error:
                failures[f"{call.__name__}: {type(error).__name__}"] += 1

        def query(robot: int) -> None:
            parameters = {"type": "pose", "robot": f"r{robot}", "max_age_s": 5.0, "deadline_ms": 20_000}
            call_s = time.perf_counter()
            try:
                bus.call(keys.orchestrator_rpc("ground", "request"), parameters, timeout_s=21)
            finally:
                spans.append(time.perf_counter() - call_s)

        def stored() -> int:
            stat = bus.call(keys.dpm_rpc("ground", "stat"), timeout_s=20).body()
            return int(stat["counters"]["inserted"])

        list(pool.map(partial(attempt, query), range(robots)))  # activates the stand-in hosts
        time.sleep(5.0)
        spans.clear()
        failures.clear()
        before, count, start_s, k = cpu(started), stored(), time.monotonic(), 0
        searches = clouds = 0
        while (elapsed_s := time.monotonic() - start_s) < seconds:
            pool.submit(attempt, query, k % robots)
            if k * ROBOT["search"] >= searches * ROBOT["request"]:
                pool.submit(attempt, made.search, k)
                searches += 1
            if k * ROBOT["megabyte"] >= clouds * made.cloud_mb * ROBOT["request"]:
                pool.submit(attempt, made.megabyte, k)
                clouds += 1
            k += 1
            time.sleep(max(start_s + k / (ROBOT["request"] * robots) - time.monotonic(), 0.0))
        elapsed_s, after, count = time.monotonic() - start_s, cpu(started), stored() - count
        memory = {name: memory_mb(started.processes[name].pid) for name in PROCESSES}
    rates = {
        "heartbeat": robots * ROBOT["heartbeat"],
        "pose": (count - clouds) / elapsed_s,
        "megabyte": clouds * made.cloud_mb / elapsed_s,
        "search": searches / elapsed_s,
        "request": len(spans) / elapsed_s,
    }
    found = {name: round((after[name] - before[name]) / elapsed_s, 3) for name in PROCESSES}
    expected = {
        name: round(
            measured["idle"][name] + sum(rates[x] * measured["per_call_ms"][x][name] / 1e3 for x in ROBOT), 3
        )
        for name in PROCESSES
    }
    return {
        "robots": robots,
        "rates_per_s": {name: round(value, 2) for name, value in rates.items()},
        "cpu": found,
        "model_cpu": expected,
        "ratio": {name: round(found[name] / expected[name], 2) for name in PROCESSES},
        "request_p50_ms": round(1e3 * statistics.median(spans), 1),
        "request_p95_ms": round(1e3 * float(np.percentile(spans, 95)), 1),
        "failures": failures,
        "memory_mb": memory,
    }


def main() -> None:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--robots", type=int, default=100)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--calls", type=int, default=400)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    measured = coefficients(args.calls)
    report: dict[str, Any] = {"load": os.getloadavg()[0], "activity": ROBOT, "coefficients": measured}
    report["model"] = model(measured)
    report["check"] = check(measured, args.robots, args.seconds)
    write_report(report, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cost of the traces of OpenTelemetry: CPU time of router, DPM, orchestrator and stand-in hosts.

    python benchmarks/tracing.py [--rounds N] [--seconds S] [--requests-per-s R] [--robots N] [--out FILE]

The stand-in hosts of ``--robots`` rovers store a pose of each rover at ``--rate-hz`` in the DPM, as
``benchmarks/orchestrator.py`` does; a client sends requests for poses at a constant rate. ``off`` and
``on`` are systems without and with ``CDFF_TRACES`` (a folder), started one after the other in changing
order; the value of a round is the CPU time of all processes in ``--seconds``. ``per_request_us`` is the
CPU time of the spans of one request, measured with requests without a pause. ``span_us`` is the CPU
time of one span of a call in this process, with its export to a file and the context in the attachments
of caller and callee; ``mission`` is the CPU time of the spans of the demonstration (``cdff demo
--once``, all processes), relative to that of all its processes.
"""

from __future__ import annotations

import argparse
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).resolve().parents[1]), str(Path(__file__).resolve().parent)]

import yaml  # noqa: E402
from _fleet import fleet_profile  # noqa: E402
from _report import write_report  # noqa: E402
from _services import cpu_s  # noqa: E402
from orchestrator import system  # noqa: E402

from cdff_common import tracing  # noqa: E402
from cdff_common.bus import Bus, keys  # noqa: E402
from cdff_common.bus.message import pack, split_context, with_context  # noqa: E402
from cdff_common.tracing import VARIABLE  # noqa: E402

_KEY = "cdff/@v1/mana/orchestrator/@rpc/request"
_FLEET = Path(__file__).with_name("_fleet.py")


def run(args: argparse.Namespace, *, is_on: bool) -> dict[str, Any]:
    """Return CPU seconds of all processes per second, and CPU time of one request without pauses."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ.pop(VARIABLE, None)
        if is_on:
            os.environ[VARIABLE] = str(folder / "traces")
        profile = folder / "profile.yaml"
        profile.write_text(
            yaml.safe_dump(fleet_profile(args.robots).model_dump(mode="json", exclude_defaults=True))
        )
        other = [str(_FLEET), "--profile", str(profile), "--rate-hz", str(args.rate_hz)]
        with system(folder, profile, other, ("ground", "hosts"), "r0") as running:
            pids = [process.pid for process in running.processes.values()]

            def total_s() -> float:
                return sum(cpu_s(pid) for pid in pids)

            with Bus.open(running.endpoint, name="benchmark", wait_s=30) as bus:
                for k in range(args.robots):  # activates the stand-in hosts
                    request(bus, k)
                time.sleep(5.0)
                before_s, started_s, count = total_s(), time.monotonic(), 0
                while time.monotonic() - started_s < args.seconds:
                    request(bus, count % args.robots)
                    count += 1
                    time.sleep(max(started_s + count / args.requests_per_s - time.monotonic(), 0.0))
                paced_s = (total_s() - before_s) / (time.monotonic() - started_s)
                before_s = total_s()
                for k in range(args.burst):
                    request(bus, k % args.robots)
                burst_us = 1e6 * (total_s() - before_s) / args.burst
        traces = list((folder / "traces").glob("*.jsonl"))
        spans = sum(file.read_text().count('"spanId"') for file in traces)
    return {"cpu_s_per_s": paced_s, "request_us": burst_us, "requests": count, "spans": spans}


def span_us(count: int = 20_000) -> float:
    """Return the CPU time of one span, microseconds, less that of the same calls without a trace."""
    header = pack({"id": "a" * 36, "seq": 1, "frame": "site"})

    def work() -> None:
        for _ in range(count):
            for _ in tracing.traced(_KEY, tracing.current(), iter((b"",))):
                split_context(with_context(header))

    times = []
    for is_on in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            if is_on:
                tracing.start("benchmark", {VARIABLE: folder})
            start_s = time.process_time()
            work()
            tracing.stop()
            times.append(time.process_time() - start_s)
    return round(1e6 * (times[1] - times[0]) / count, 1)


def mission(cost_us: float) -> dict[str, float]:
    """Return spans and CPU seconds of the demonstration with traces, and the fraction that the spans take."""
    with tempfile.TemporaryDirectory() as name:
        environment = {**os.environ, VARIABLE: name}
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        command = [sys.executable, "-m", "cdff_common.cli", "demo", "--once"]
        subprocess.run(command, env=environment, check=True, stdout=subprocess.DEVNULL)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        spans = sum(file.read_text().count('"spanId"') for file in Path(name).glob("*.jsonl"))
    used_s = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"spans": spans, "cpu_s": round(used_s, 1), "fraction": round(1e-6 * spans * cost_us / used_s, 5)}


def request(bus: Bus, robot: int) -> None:
    """Request the pose of a rover and check that there is an answer."""
    key = keys.orchestrator_rpc("ground", "request")
    parameters = {"type": "pose", "robot": f"r{robot}", "max_age_s": 30, "deadline_ms": 10_000}
    assert bus.call(key, parameters, timeout_s=11.0).payload


def main() -> None:
    """Measure and write the report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--requests-per-s", type=float, default=2.0)
    parser.add_argument("--robots", type=int, default=4)
    parser.add_argument("--rate-hz", type=float, default=2.0)
    parser.add_argument("--burst", type=int, default=300)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    cost_us = span_us()
    rounds: dict[bool, list[dict[str, Any]]] = {False: [], True: []}
    for number in range(args.rounds):
        for is_on in (False, True) if number % 2 == 0 else (True, False):
            rounds[is_on].append(run(args, is_on=is_on))
    report: dict[str, Any] = {"load": os.getloadavg()[0], "rounds": rounds}
    off, on = (
        {key: statistics.median(r[key] for r in rounds[is_on]) for key in ("cpu_s_per_s", "request_us")}
        for is_on in (False, True)
    )
    report |= {"off": off, "on": on}
    report |= {"span_us": cost_us, "mission": mission(cost_us)}
    report["per_request_us"] = round(on["request_us"] - off["request_us"], 1)
    report["ratio"] = round(on["cpu_s_per_s"] / off["cpu_s_per_s"], 4)
    report["ratio_from_request_cost"] = round(
        1.0 + 1e-6 * report["per_request_us"] * args.requests_per_s / off["cpu_s_per_s"], 4
    )
    write_report(report, args.out)


if __name__ == "__main__":
    main()

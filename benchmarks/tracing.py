# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cost of the traces of OpenTelemetry: CPU time of router, DPM, orchestrator and stand-in hosts.

    python benchmarks/tracing.py [--rounds N] [--seconds S] [--requests-per-s R] [--robots N] [--out FILE]

The stand-in hosts of ``--robots`` rovers store a pose of each rover at ``--rate-hz`` in the DPM, as
``benchmarks/orchestrator.py`` does; a client sends requests for poses at a constant rate. ``off`` and
``on`` are systems without and with ``CDFF_TRACES`` (a folder), started one after the other in changing order;
the value of a round is the CPU time of all processes in ``--seconds``. ``per_request_us`` is the CPU time of
the spans of one request, measured with requests without a pause.
"""

from __future__ import annotations

import argparse
import os
import statistics
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

from cdff_common.bus import Bus, keys  # noqa: E402
from cdff_common.tracing import VARIABLE  # noqa: E402

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
    report["per_request_us"] = round(on["request_us"] - off["request_us"], 1)
    report["ratio"] = round(on["cpu_s_per_s"] / off["cpu_s_per_s"], 4)
    report["ratio_from_request_cost"] = round(
        1.0 + 1e-6 * report["per_request_us"] * args.requests_per_s / off["cpu_s_per_s"], 4
    )
    write_report(report, args.out)


if __name__ == "__main__":
    main()

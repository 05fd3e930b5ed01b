# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure start and end of the whole system, its CPU time and memory, and the restart of each killed process.

    python benchmarks/startup.py [--out FILE] [--runs N] [--profile FILE]

Each run starts ``cdff up`` with an empty data folder and free ports, and waits for every liveliness token. It
sums CPU seconds and memory (PSS, which counts shared pages once) over all processes, and measures the time
until they have ended after SIGTERM. Before that it kills each process in turn and measures the time until its
successor runs and every liveliness token is there again.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import sys
import time
from pathlib import Path

import psutil
from _report import write_report

from cdff_common.bus import Bus
from cdff_common.interfaces.profile import load_profile
from cdff_dev.missions.stage import Stage
from cdff_dev.ports import free_port

ROOT = Path(__file__).resolve().parent.parent


def one_run(profile_path: Path) -> dict[str, float]:
    """Start the system, measure it, and end it."""
    start_s = time.monotonic()
    stage = Stage(
        load_profile(profile_path), profile_path, f"tcp/127.0.0.1:{free_port()}", f"127.0.0.1:{free_port()}"
    )
    with stage, Bus.open(stage.connect, name="bench", wait_s=20) as bus:
        stage.wait_ready(bus)
        ready_s = time.monotonic() - start_s
        processes = psutil.Process(stage.supervisor_pid).children(recursive=True)
        cpu_s = sum(sum(p.cpu_times()[:2]) for p in processes)
        pss_mb = sum(p.memory_full_info().pss for p in processes) / 1e6
        restarts_s = [restart(stage, bus, process) for process in processes]
        stop_s = time.monotonic()
        stage.end()
        end_s = time.monotonic() - stop_s
    return {
        "processes": len(processes),
        "ready_s": ready_s,
        "cpu_s": cpu_s,
        "pss_mb": pss_mb,
        "restart_s": statistics.median(restarts_s),
        "slowest_restart_s": max(restarts_s),
        "end_s": end_s,
    }


def restart(stage: Stage, bus: Bus, process: psutil.Process) -> float:
    """Kill a process; return the time until it is replaced and the system is complete, seconds."""
    supervisor = psutil.Process(stage.supervisor_pid)
    count, command = len(supervisor.children()), process.cmdline()
    process.kill()
    start_s = time.monotonic()
    process.wait()
    while len(supervisor.children()) < count:
        time.sleep(0.01)
    stage.wait_ready(bus)
    restart_s = time.monotonic() - start_s
    print(f"{restart_s:6.2f} s {' '.join(command[1:6])}", file=sys.stderr)
    return restart_s


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--profile", type=Path, default=ROOT / "deploy" / "profiles" / "rover_traverse.yaml")
    args = parser.parse_args()
    runs = [one_run(args.profile) for _ in range(args.runs)]
    report = {
        "benchmark": "startup",
        "profile": args.profile.stem,
        "python": platform.python_version(),
        "cores": os.cpu_count(),
        "median": {key: round(statistics.median(run[key] for run in runs), 2) for key in runs[0]},
        "runs": runs,
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()

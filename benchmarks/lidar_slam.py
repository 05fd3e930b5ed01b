# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Compare lidar_slam with kiss-icp on the same simulated sweeps of 64 x 1800: time and memory.

OMP_NUM_THREADS=1 python benchmarks/lidar_slam.py [--sweeps N] [--seed N] [--rings N] [--columns N]
    [--tracking JSON] [--peer-python PYTHON] [--out FILE]

The sweeps of deploy/simulation/lidar_traverse.yaml are simulated first and stored in memory. Both programs
run on one thread; the first ten sweeps are a warm-up. The times of lidar_slam include loop closures; kiss-icp
has none. Errors are those of the odometry over segments of 20 m.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from _report import write_report

from cdff_common.geometry import FrameGraph, UncertainTransform
from cdff_common.interfaces.dfpc import DfpcContext, Sample
from cdff_common.interfaces.registry import Registry
from cdff_common.types import LidarScan
from cdff_dev.compare.trajectory.compare import compare
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.simulate.traverse import simulate
from evaluation.peers.environments import SweepFile, peer_python

WARM_UP = 10
Step = Callable[[LidarScan], Any]


def sweeps(seed: int, count: int, rings: int, columns: int) -> tuple[list[LidarScan], Track, np.ndarray]:
    """Return the sweeps, the true poses of the lidar, and its mount ``T_base_lidar``."""
    base = load_scenario("lidar_traverse", seed)
    lidar = base.lidar.model_copy(update={"rings": rings, "columns": columns})
    scenario = base.model_copy(update={"duration_s": count / 2.0 + 0.6, "lidar": lidar})
    mount, result, truth = scenario.lidar.mount.matrix(), [], {}
    for entry, value in simulate(scenario, workers=0):
        if entry.stream.endswith("/lidar.scan"):
            result.append(value)
        elif entry.stream.endswith("/truth.pose"):
            truth[entry.stamp_ns] = value.transform.matrix @ mount
    stamps = np.array([s.t1_ns for s in result])
    return result, Track("truth", stamps, np.array([truth[int(t)] for t in stamps])), mount


def lidar_slam(mount: np.ndarray, tracking: dict[str, Any]) -> tuple[Step, Callable[[], dict[str, float]]]:
    """Return a function that processes a sweep, and one that returns the size of the map.

    ``tracking`` contains parameters of the registration.
    """
    frames = FrameGraph()
    frames.set_static("mana/base", "mana/lidar", UncertainTransform.exact(mount))
    node = Registry.default().make_dfpc("lidar_slam")
    node.configure({"tracking": tracking}, DfpcContext("mana", frames))

    def step(scan: LidarScan) -> Any:
        outputs = list(node.step(Sample("scan", scan.t1_ns, 0, scan)))
        return next(o.value.transform.matrix for o in outputs if o.port == "odometry")

    def memory() -> dict[str, float]:
        return {"keyframes": len(node.keyframes), "keyframes_mb": round(node.keyframes.point_bytes / 1e6, 1)}

    return step, memory


def measure_sweeps(name: str, step: Step, scans: list[LidarScan], truth: Track) -> dict[str, Any]:
    """Process all sweeps; return times and errors."""
    cpu_s, wall_s, poses = [], [], []
    for scan in scans:
        started_cpu_s, started_s = time.process_time(), time.perf_counter()
        poses.append(step(scan))
        cpu_s.append(time.process_time() - started_cpu_s)
        wall_s.append(time.perf_counter() - started_s)
    return summary(name, np.array(poses), np.array(cpu_s), np.array(wall_s), truth)


def summary(
    name: str, poses: np.ndarray, cpu_s: np.ndarray, wall_s: np.ndarray, truth: Track
) -> dict[str, Any]:
    """Return times per sweep and drift of one program."""
    results = compare(Track(name, truth.stamps_ns, poses), truth, segments_m=(20.0,)).results
    cpu, wall = cpu_s[WARM_UP:], wall_s[WARM_UP:]
    return {
        "cpu_ms": {
            "mean": ms(cpu.mean()),
            "median": ms(np.median(cpu)),
            "p95": ms(np.quantile(cpu, 0.95)),
            "max": ms(cpu.max()),
        },
        "wall_ms": {"mean": ms(wall.mean()), "median": ms(np.median(wall))},
        "sweeps_per_cpu_s": round(1.0 / float(cpu.mean()), 1),
        "drift_percent_of_20_m": round(results["drift"]["segments"][0]["translation_percent"], 4),
    }


def ms(seconds: float) -> float:
    """Return milliseconds, rounded to a tenth."""
    return round(1000.0 * float(seconds), 1)


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sweeps", type=int, default=200, help="number of sweeps (two per second)")
    parser.add_argument("--seed", type=int, default=20260901, help="seed of the scenario")
    parser.add_argument("--rings", type=int, default=64, help="rings of a sweep")
    parser.add_argument("--columns", type=int, default=1800, help="columns of a sweep")
    parser.add_argument(
        "--tracking", type=json.loads, default={}, help="parameters of the registration, JSON"
    )
    parser.add_argument(
        "--peer-python", default=peer_python("kiss_icp"), help="interpreter with kiss-icp; CDFF_PEER_PYTHON"
    )
    parser.add_argument("--out", type=Path, help="JSON report")
    args = parser.parse_args()
    scans, truth, mount = sweeps(args.seed, max(args.sweeps, 60), args.rings, args.columns)
    report: dict[str, Any] = {
        "machine": f"{platform.machine()}, {os.cpu_count()} cores",
        "sweeps": len(scans),
        "points_a_sweep": int(np.mean([len(s.points_m) for s in scans])),
    }
    step, memory = lidar_slam(mount, args.tracking)
    report["cdff lidar_slam"] = measure_sweeps("cdff", step, scans, truth) | memory()
    python = args.peer_python
    if python:
        with SweepFile() as sweep_file:
            for scan in scans:
                sweep_file.append(scan)
            report["kiss-icp"] = summary("kiss-icp", *sweep_file.kiss_icp(python, (0.5, 60.0)), truth)
    else:
        report["kiss-icp"] = "skipped: --peer-python names no interpreter with kiss-icp"
    write_report(report, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure lidar localisation: CPU seconds per sweep with and without a guess, cost of its DFNs, map memory.

OMP_NUM_THREADS=1 python benchmarks/lidar_localisation.py [--trials N] [--out FILE]

The map and the sweeps are those of ``evaluation.lidar_localisation``. Comparison with small_gicp and
KISS-ICP: ``python -m evaluation lidar_localisation_peers``.
"""

from __future__ import annotations

import argparse
import os
import platform
import statistics
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
from _report import measure, write_report

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.place_search.interface import PlaceSearchInputs
from cdff_core.dfns.pose_estimation.interface import PoseEstimationInputs
from evaluation.lidar_localisation import localise, make_localiser, simulated_ground, trial


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    ground = simulated_ground()
    points = ground.map(0)
    tracemalloc.start()
    dfpc = make_localiser(points)
    memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    cpu_s: dict[str, list[float]] = {"from 2 m and 20 deg off": [], "without a guess": []}
    for seed in range(args.trials + 1):  # the first trial is a warm-up
        _, sweep, T_guess = trial(ground, seed)
        for start, guess in zip(cpu_s, (UncertainTransform(T_guess), None), strict=True):
            started = time.process_time()
            localise(dfpc, sweep, guess)
            cpu_s[start].append(time.process_time() - started)
    map_points = dfpc.store.get("scan_map").points_m
    search, estimate = dfpc.dfn("search"), Registry.default().make_dfn("pose_estimation")
    estimate.configure()
    T, C = np.eye(4), 1e-4 * np.eye(6)
    report: dict[str, Any] = {
        "benchmark": "lidar_localisation",
        "machine": platform.machine(),
        "load_1min": os.getloadavg()[0],
        "trials": args.trials,
        "map_points": len(map_points),
        "map_mb": round(memory_mb, 1),
        "dfpc": {start: {"cpu_s": round(statistics.median(times[1:]), 4)} for start, times in cpu_s.items()},
        "dfns": {
            "PlaceSearch/ElevationCorrelation": measure(
                lambda: search.process(
                    PlaceSearchInputs(map_points=map_points, sweep_points=sweep.astype(np.float64))
                ),
                5,
            ),
            "PoseEstimation/EllipsoidalIntersection": measure(
                lambda: estimate.process(
                    PoseEstimationInputs(
                        prediction=T, prediction_covariance=C, measurement=T, measurement_covariance=C
                    )
                ),
                100,
            ),
        },
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Cost of lidar localisation: CPU seconds of a sweep from a guess and from nothing, of its DFNs, and memory of the map.

OMP_NUM_THREADS=1 python benchmarks/lidar_localisation.py [--trials N] [--out FILE]

The map and the sweeps are those of ``cdff_dev.evaluate.lidar_localisation``. Beside small_gicp and KISS-ICP:
``python -m cdff_dev.evaluate lidar_localisation_peers``.
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
from _report import give_out, measured

from cdff_common.geometry import UncertainTransform
from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.place_search._interface import PlaceSearchInputs
from cdff_core.dfns.pose_estimation._interface import PoseEstimationInputs
from cdff_dev.evaluate.lidar_localisation import localised, localiser, place, trial


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=10)
    parser.add_argument("--out", type=Path)
    args = parser.parse_args()
    ground = place()
    points = ground.map(0)
    tracemalloc.start()
    dfpc = localiser(points)
    memory_mb = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    spent: dict[str, list[float]] = {"from 2 m and 20 deg off": [], "from nothing": []}
    for seed in range(args.trials + 1):  # the first warms up
        _, sweep, off = trial(ground, seed)
        for start, guess in zip(spent, (UncertainTransform(off), None), strict=True):
            began = time.process_time()
            localised(dfpc, sweep, guess)
            spent[start].append(time.process_time() - began)
    whole = dfpc.store.get("scan_map").points_m
    search, estimate = dfpc.dfn("search"), Registry.default().make_dfn("pose_estimation")
    estimate.configure()
    known, C = np.eye(4), 1e-4 * np.eye(6)
    report: dict[str, Any] = {
        "benchmark": "lidar_localisation", "machine": platform.machine(), "load_1min": os.getloadavg()[0],
        "trials": args.trials, "map_points": len(whole), "map_mb": round(memory_mb, 1),
        "dfpc": {start: {"cpu_s": round(statistics.median(times[1:]), 4)} for start, times in spent.items()},
        "dfns": {
            "PlaceSearch/ElevationCorrelation": measured(
                lambda: search.process(PlaceSearchInputs(whole, sweep.astype(np.float64))), 5
            ),
            "PoseEstimation/EllipsoidalIntersection": measured(
                lambda: estimate.process(PoseEstimationInputs(known, C, known, C)), 100
            ),
        },
    }  # fmt: skip
    give_out(report, args.out)


if __name__ == "__main__":
    main()

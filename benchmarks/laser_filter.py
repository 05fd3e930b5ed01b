# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU time and memory of both implementations of the DFN LaserFilter on a scan of 1080 beams.

python benchmarks/laser_filter.py [--out FILE] [--rounds N]
"""

from __future__ import annotations

import argparse
import platform
import statistics
import time
import tracemalloc
from pathlib import Path

import numpy as np
from _report import write_report

from cdff_common.interfaces.registry import Registry
from cdff_common.types import LaserScan, RigidBodyState
from cdff_core.dfns.laser_filter.interface import LaserFilterInputs

BEAMS = 1080
SEED = 1


def scan() -> LaserScan:
    """Return a scan of a room of 6 m with wrong ranges: 270 degrees in steps of a quarter of a degree."""
    rng = np.random.default_rng(SEED)
    angle = np.deg2rad(-135 + 0.25 * np.arange(BEAMS))
    walls_m = 3.0 / np.maximum(np.abs(np.cos(angle)), np.abs(np.sin(angle)))
    walls_m[rng.choice(BEAMS, 40, replace=False)] *= 0.5
    noise_m = rng.normal(0, 0.01, BEAMS)
    return LaserScan(
        ranges=np.round((walls_m + noise_m) * 1000).astype(np.int32),
        remission=np.ones(BEAMS),
        start_angle=float(angle[0]),
        angular_resolution=float(np.deg2rad(0.25)),
        min_range=20,
        max_range=30_000,
    )


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=500)
    args = parser.parse_args()
    inputs = LaserFilterInputs(scan_samples=scan(), laser_2_body_tf=RigidBodyState())
    report: dict[str, object] = {
        "benchmark": "laser_filter",
        "python": platform.python_version(),
        "beams": BEAMS,
    }
    registry = Registry.default()
    for implementation in registry.dfn("laser_filter").implementations:
        node = registry.make_dfn("laser_filter", implementation)
        node.configure()
        node.process(inputs)
        times = []
        for _ in range(args.rounds):
            started = time.process_time()
            node.process(inputs)
            times.append(time.process_time() - started)
        tracemalloc.start()
        node.process(inputs)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        report[implementation] = {
            "cpu_s_median": round(statistics.median(times), 6),
            "memory_mb": round(peak / 1e6, 2),
        }
    write_report(report, args.out)


if __name__ == "__main__":
    main()

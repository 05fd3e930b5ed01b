# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Measure CPU time and memory of loop detection: one place is described and compared with 200 others.

python benchmarks/loop_detection.py [--out FILE] [--rounds N]

The clouds have 20 000 points within 18 m of a robot on fractal ground with rocks, as in
``lidar_localisation_searches``. The time is the minimum of CPU seconds (``time.process_time``); memory is the
peak allocation of a call.
"""

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np
from _report import measure, write_report

from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.loop_detection.interface import LoopDetectionInputs
from evaluation.scenes.terrain import Terrain

POINTS, RANGE_M, PLACES, SENSOR_M = 20_000, 18.0, 200, 1.6


def observed_points(ground: Terrain, rng: np.random.Generator) -> np.ndarray:
    """Return points (20 000, 3) around a random place, in the frame of a level robot at this place."""
    place_xy = rng.uniform(RANGE_M + 1.0, ground.size_m - RANGE_M - 1.0, 2)
    r, a = RANGE_M * np.sqrt(rng.random(POINTS)), rng.uniform(-np.pi, np.pi, POINTS)
    xy = np.column_stack([r * np.cos(a), r * np.sin(a)])
    z = ground.height(xy + place_xy) - ground.height(place_xy[None])[0] - SENSOR_M
    return np.column_stack([xy, z])


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=20)
    args = parser.parse_args()
    rng, ground = np.random.default_rng(1), Terrain(1)
    detect = Registry.default().make_dfn("loop_detection", "HeightContext")
    detect.configure()
    database = np.stack(
        [
            detect.process(LoopDetectionInputs(points=observed_points(ground, rng))).descriptor
            for _ in range(PLACES)
        ]
    )
    inputs = LoopDetectionInputs(points=observed_points(ground, rng), database=database)
    candidates = len(detect.process(inputs).candidates)
    report: dict[str, Any] = {
        "benchmark": "loop_detection",
        "python": platform.python_version(),
        "machine": platform.machine(),
        "load_1min": os.getloadavg()[0],
        "points": POINTS,
        "places": PLACES,
        "candidates": candidates,
        "LoopDetection/HeightContext": measure(lambda: detect.process(inputs), args.rounds),
    }
    write_report(report, args.out)


if __name__ == "__main__":
    main()

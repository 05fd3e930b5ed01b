# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""CPU seconds and memory of loop detection: one place described and compared with 200 others.

python benchmarks/loop_detection.py [--out FILE] [--rounds N]

Clouds of 20 000 points within 18 m of a robot on fractal ground with rocks, as ``lidar_localisation_searches`` has
them. Least CPU seconds (``time.process_time``; other load only adds); memory is the largest sum of what a call holds.
"""

from __future__ import annotations

import argparse
import os
import platform
from pathlib import Path
from typing import Any

import numpy as np
from _report import give_out, measured

from cdff_common.interfaces.registry import Registry
from cdff_core.dfns.loop_detection._interface import LoopDetectionInputs
from cdff_dev.evaluate._terrain import Terrain

POINTS, RANGE_M, PLACES, SENSOR_M = 20_000, 18.0, 200, 1.6


def seen(ground: Terrain, rng: np.random.Generator) -> np.ndarray:
    """Points (20 000, 3) around a place, in the frame of a level robot there."""
    here = rng.uniform(RANGE_M + 1.0, ground.size_m - RANGE_M - 1.0, 2)
    r, a = RANGE_M * np.sqrt(rng.random(POINTS)), rng.uniform(-np.pi, np.pi, POINTS)
    about = np.column_stack([r * np.cos(a), r * np.sin(a)])
    z = ground.height(about + here) - ground.height(here[None])[0] - SENSOR_M
    return np.column_stack([about, z])


def main() -> None:
    """Measure and print JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path)
    parser.add_argument("--rounds", type=int, default=20)
    args = parser.parse_args()
    rng, ground = np.random.default_rng(1), Terrain(1)
    detect = Registry.default().make_dfn("loop_detection", "HeightContext")
    detect.configure()
    database = np.stack([detect.process(LoopDetectionInputs(seen(ground, rng))).descriptor for _ in range(PLACES)])
    inputs = LoopDetectionInputs(seen(ground, rng), database)
    candidates = len(detect.process(inputs).candidates)
    report: dict[str, Any] = {
        "benchmark": "loop_detection", "python": platform.python_version(), "machine": platform.machine(),
        "load_1min": os.getloadavg()[0], "points": POINTS, "places": PLACES, "candidates": candidates,
        "LoopDetection/HeightContext": measured(lambda: detect.process(inputs), args.rounds),
    }  # fmt: skip
    give_out(report, args.out)


if __name__ == "__main__":
    main()

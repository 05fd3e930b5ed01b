# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the map size of ``lidar_slam`` over several laps of the same path."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cdff_dev.simulate.scenario import load_scenario
from evaluation.runs.lidar_slam import SEEDS, Run, drive, errors
from evaluation.runs.lidar_slam_page import laps_table as table

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
LAPS, RADIUS_M = 3, 40.0
#: Path length of a lap beyond the full circle, so that the rover passes the first keyframe again.
OVERLAP_M = 2.0


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the size of the map after each lap of a circle, and the errors of the final trajectory."""
    base = load_scenario("lidar_traverse", SEEDS[0])
    lap_m = 2.0 * math.pi * RADIUS_M + OVERLAP_M
    curvature = ((0.0, 1.0 / RADIUS_M), (1e4, 1.0 / RADIUS_M))
    robots = {name: r.model_copy(update={"curvature_1pm": curvature}) for name, r in base.robots.items()}
    scenario = base.model_copy(update={"robots": robots, "duration_s": float(math.ceil(LAPS * lap_m + 10.0))})
    rows: dict[int, dict[str, float]] = {}

    def record_lap(run: Run) -> None:
        path_length_m = float(run.products["pose"][-1].header.quality.metrics["path_length_m"])
        lap = int(path_length_m / lap_m)
        if lap and lap not in rows:
            rows[lap] = map_size(run) | {"path_length_m": round(path_length_m, 1)}

    run = drive(scenario, progress, on_sweep=record_lap)
    final = errors(run.trajectory(), run)
    loops = int(run.products["graph"][-1].header.quality.metrics["loops"])
    return {
        "lap_m": round(lap_m - OVERLAP_M, 1),
        "after_lap": rows,
        "loops": loops,
        "trajectory at the end": final,
    }


def map_size(run: Run) -> dict[str, float]:
    """Return the numbers of keyframes and edges, and the size of the clouds, MB."""
    keyframes = run.node.keyframes
    return {
        "keyframes": len(keyframes),
        "edges": len(keyframes.edges),
        "cloud_mb": round(keyframes.point_bytes / 1e6, 2),
    }

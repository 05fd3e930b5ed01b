# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What ``lidar_slam`` keeps over laps of one way: memory is that of the map, not of the time."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from cdff_dev.evaluate._lidar_slam_drive import SEEDS, Run, drive, errors
from cdff_dev.evaluate._lidar_slam_page import laps_table as table
from cdff_dev.simulate.scenario import load_scenario

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
LAPS, RADIUS_M = 3, 40.0
#: A lap is told a little further than round: the key frame at the begin is met again.
BEYOND_M = 2.0


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Key frames, edges and bytes after each lap of a circle on the ground of the traverse; the error at the end."""
    base = load_scenario("lidar_traverse", SEEDS[0])
    round_m = 2.0 * math.pi * RADIUS_M + BEYOND_M
    curvature = ((0.0, 1.0 / RADIUS_M), (1e4, 1.0 / RADIUS_M))
    robots = {name: r.model_copy(update={"curvature_1pm": curvature}) for name, r in base.robots.items()}
    scenario = base.model_copy(update={"robots": robots, "duration_s": float(math.ceil(LAPS * round_m + 10.0))})
    rows: dict[int, dict[str, float]] = {}

    def keep(run: Run) -> None:
        way_m = float(run.products["pose"][-1].header.quality.metrics["way_m"])
        lap = int(way_m / round_m)
        if lap and lap not in rows:
            rows[lap] = held(run) | {"way_m": round(way_m, 1)}

    run = drive(scenario, progress, each=keep)
    final = errors(run.trajectory(), run)
    loops = int(run.products["graph"][-1].header.quality.metrics["loops"])
    return {"lap_m": round(round_m - BEYOND_M, 1), "after_lap": rows, "loops": loops, "trajectory at the end": final}


def held(run: Run) -> dict[str, float]:
    """What is kept now."""
    places = run.node.places
    return {
        "keyframes": len(places), "edges": len(places.edges), "cloud_mb": round(places.point_bytes / 1e6, 2),
    }  # fmt: skip

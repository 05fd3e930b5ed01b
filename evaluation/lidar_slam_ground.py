# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate ``lidar_slam`` on plains without relief, and with lidars of few points.

The simulated scenarios are ``deploy/simulation/lidar_plain.yaml``, and the start of ``lidar_traverse.yaml``
with fewer points per sweep.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_dev.compare.registration.rates import bounds
from cdff_dev.compare.trajectory.track import Track
from cdff_dev.simulate.scenario import load_scenario
from evaluation.runs.lidar_slam import Run, drive, errors
from evaluation.runs.lidar_slam_page import ground_table as table

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
PLAIN_SEEDS = (20260902, 20260912)
SPARSE_SEEDS = (20260901, 20260911)
SPARSE_S = 60.0
#: Rings, columns, and parameters of the registration other than the defaults.
SPARSE: tuple[tuple[int, int, dict[str, Any]], ...] = (
    (32, 450, {}),
    (16, 1800, {}),
)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results on plains and with sparse lidars."""
    return {"lidar_plain": plains(progress), "sparse": sparse(progress)}


def sparse(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return drift and quality for lidars with fewer rings or columns."""
    rows = {}
    for rings, columns, tracking in SPARSE:
        for seed in SPARSE_SEEDS:
            base = load_scenario("lidar_traverse", seed)
            lidar = base.lidar.model_copy(update={"rings": rings, "columns": columns})
            run = drive(
                base.model_copy(update={"duration_s": SPARSE_S, "lidar": lidar}),
                progress,
                slam_config={"tracking": tracking},
            )
            rows[f"{rings} x {columns}, seed {seed}"] = {"tracking": tracking} | _drift_and_quality(run)
    return rows


def _drift_and_quality(run: Run) -> dict[str, Any]:
    """Return the drift of the odometry and the number of sweeps of each status."""
    statuses = Counter(str(p.header.quality.status) for p in run.products["odometry"])
    result = errors(run.track("odometry"), run)
    return {
        "drift_percent": result["drift_percent"],
        "ate_rmse_m": result["ate_rmse_m"],
        "sweeps": dict(statuses),
    }


def plains(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the rates of sweeps reported as degenerate on and off a plain, and the drift across it."""
    # Degenerate sweeps and all sweeps, by position. On the plain, no relief is within range.
    counts = {"on": [0, 0], "off": [0, 0]}
    rows: dict[str, Any] = {}
    for seed in PLAIN_SEEDS:
        run = drive(load_scenario("lidar_plain", seed), progress, wheels=True)
        for product in run.products["pose"][6:]:
            x = abs(float(run.truth[product.header.t1_ns][0, 3]))
            degenerate = any(r.startswith("degenerate:") for r in product.header.quality.reasons)
            position = "on" if x < 35.0 else "off" if x > 105.0 else None
            if position is not None:
                counts[position][0] += degenerate
                counts[position][1] += 1
        odometry = run.track("odometry")
        rows[f"seed {seed}, with wheel odometry"] = errors(odometry, run)
        stamps = [t for t in odometry.stamps_ns.tolist() if t in run.wheels]
        rows[f"seed {seed}, wheels alone"] = errors(
            Track("wheels", np.array(stamps), np.array([run.wheels[t] for t in stamps])), run
        )
    return {
        "degenerate_on_the_plain": _rate(*counts["on"]),
        "degenerate_outside_the_plain": _rate(*counts["off"]),
        **rows,
    }


def _rate(degenerate: int, trials: int) -> dict[str, Any]:
    return {"degenerate": degenerate, "trials": trials, "interval_95": bounds(degenerate, trials)}

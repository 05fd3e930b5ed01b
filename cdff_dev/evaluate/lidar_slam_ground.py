# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``lidar_slam`` where the ground says little: plains without relief, and lidars with few points.

Simulated: ``deploy/simulation/lidar_plain.yaml``, and the begin of ``lidar_traverse.yaml`` with fewer points.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cdff_dev.evaluate._lidar_slam_drive import Run, drive, errors
from cdff_dev.evaluate._lidar_slam_page import ground_table as table
from cdff_dev.registration.rates import bounds
from cdff_dev.simulate.scenario import load_scenario
from cdff_dev.trajectory.track import Track

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
PLAIN_SEEDS = (20260902, 20260912)
SPARSE_SEEDS = (20260901, 20260911)
SPARSE_S = 60.0
#: Rings, columns, and parameters of the registration beside the defaults.
SPARSE: tuple[tuple[int, int, dict[str, Any]], ...] = (
    (32, 450, {}),
    (16, 1800, {}),
)


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """All figures."""
    return {"lidar_plain": plains(progress), "sparse": sparse(progress)}


def sparse(progress: Callable[[str], None]) -> dict[str, Any]:
    """Drift with fewer rings, and what the DFPC says of it."""
    rows = {}
    for rings, columns, tracking in SPARSE:
        for seed in SPARSE_SEEDS:
            base = load_scenario("lidar_traverse", seed)
            lidar = base.lidar.model_copy(update={"rings": rings, "columns": columns})
            run = drive(
                base.model_copy(update={"duration_s": SPARSE_S, "lidar": lidar}), progress,
                slam_config={"tracking": tracking},
            )  # fmt: skip
            rows[f"{rings} x {columns}, seed {seed}"] = {"tracking": tracking} | _said(run)
    return rows


def _said(run: Run) -> dict[str, Any]:
    """Drift of the poses that are not refused, and counts of the statuses."""
    statuses = Counter(str(p.header.quality.status) for p in run.products["odometry"])
    found = errors(run.track("odometry"), run)
    return {"drift_percent": found["drift_percent"], "ate_rmse_m": found["ate_rmse_m"], "sweeps": dict(statuses)}


def plains(progress: Callable[[str], None]) -> dict[str, Any]:
    """Flags on a plain without relief, where nothing else is in range, and off it; drift over it."""
    flagged = {"on": [0, 0], "off": [0, 0]}
    rows: dict[str, Any] = {}
    for seed in PLAIN_SEEDS:
        run = drive(load_scenario("lidar_plain", seed), progress, wheels=True)
        for product in run.products["pose"][6:]:
            x = abs(float(run.truth[product.header.t1_ns][0, 3]))
            degenerate = any(r.startswith("degenerate:") for r in product.header.quality.reasons)
            where = "on" if x < 35.0 else "off" if x > 105.0 else None
            if where is not None:
                flagged[where][0] += degenerate
                flagged[where][1] += 1
        odometry = run.track("odometry")
        rows[f"seed {seed}, with wheel odometry"] = errors(odometry, run)
        stamps = [t for t in odometry.stamps_ns.tolist() if t in run.wheels]
        rows[f"seed {seed}, wheels alone"] = errors(
            Track("wheels", np.array(stamps), np.array([run.wheels[t] for t in stamps])), run
        )
    return {
        "sweeps_on_the_plain_flagged": _rate(flagged["on"]), "sweeps_off_it_flagged": _rate(flagged["off"]), **rows
    }  # fmt: skip


def _rate(counted: list[int]) -> dict[str, Any]:
    return {"flagged": counted[0], "trials": counted[1], "interval_95": bounds(*counted)}

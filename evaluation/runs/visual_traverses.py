# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Run visual odometry on simulated traverses; end errors relative to the path length, and NEES."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from cdff_common.geometry import se3
from cdff_common.interfaces.product import Product
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.compare.registration.rates import nees_band
from evaluation.runs.traverse import (
    SIMULATED_CAMERA,
    TraverseRun,
    normalised_error,
    run,
    traverse_runs,
    visual_odometry,
)

SCENARIOS = ("visual_rocks", "visual_sand", "visual_low_sun")
#: The default seed of the scenarios, and two seeds that were not used to fit the noise model (seed 101 was).
SEEDS = (20261121, 103, 104)
TRAINING_SEEDS = (101,)


def traverses(progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the results of each scenario and of all drives together."""
    rows: dict[str, list[dict[str, float]]] = {name: [] for name in SCENARIOS}
    for name, seed in itertools.product(SCENARIOS, SEEDS):
        progress(f"visual odometry: {name}, seed {seed}")
        rows[name] += [score_drive(drive) for drive in traverse_runs(name, seed)[1]]
    all_rows = [row for result in rows.values() for row in result]
    return {
        "seeds": list(SEEDS),
        "training_seeds": list(TRAINING_SEEDS),
        "scenarios": {name: _summary(result) for name, result in rows.items()},
        "all": _summary(all_rows),
        "nees_band": [round(v, 2) for v in nees_band(len(all_rows))],
        "half_nees_band": [round(v, 2) for v in nees_band(2 * len(all_rows))],
    }


def score_drive(drive: TraverseRun) -> dict[str, float]:
    """Return path length, end error, NEES and pair counts by status of one drive.

    The NEES is also computed for each half: the first half ends at the middle pair; for the second half the
    odometry is started there.
    """
    images = drive.samples({"navcam.pair": "stereo"})
    products = visual_odometry(drive, 0)
    middle = next(i for i, p in enumerate(products) if p.header.t1_ns >= images[len(images) // 2].stamp_ns)
    second_half = run(
        "visual_odometry_sparse",
        drive.context,
        [s for s in images if s.stamp_ns >= products[middle].header.t1_ns],
        parameters=SIMULATED_CAMERA,
    )
    error_m, nees = path_error(drive, products)
    return {
        "path_length_m": drive.path_length_m,
        "end_percent": 100.0 * error_m / drive.path_length_m,
        "nees": nees,
        "first_half_nees": path_error(drive, products[: middle + 1])[1],
        "second_half_nees": path_error(drive, second_half)[1],
        "failed": float(len(images) - len(products)),
        "degraded": float(sum(bool(p.header.quality.reasons) for p in products)),
        "pairs": float(len(images)),
    }


def path_error(drive: TraverseRun, poses: list[Product]) -> tuple[float, float]:
    """Return the error of the motion from the first to the last pose, metres, and its NEES."""
    T_base_left = drive.context.frames.lookup(f"{drive.robot}/base", f"{drive.robot}/navcam_left", 0).matrix
    T_site_left = [drive.true_pose(p.header.t1_ns) @ T_base_left for p in (poses[0], poses[-1])]
    return normalised_error(se3.inverse(T_site_left[0]) @ T_site_left[1], poses[-1].value.transform)


def _summary(rows: list[dict[str, float]]) -> dict[str, Any]:
    return {
        "drives": len(rows),
        "path_length_m": round(float(sum(row["path_length_m"] for row in rows)), 1),
        "pairs": int(sum(row["pairs"] for row in rows)),
        "failed": int(sum(row["failed"] for row in rows)),
        "degraded": int(sum(row["degraded"] for row in rows)),
        "end_error_percent": error_summary([row["end_percent"] for row in rows]),
        "nees": error_summary([row["nees"] for row in rows], 2),
        "mean_nees": round(float(np.mean([row["nees"] for row in rows])), 2),
        "mean_half_nees": round(
            float(np.mean([row[half] for row in rows for half in ("first_half_nees", "second_half_nees")])), 2
        ),
    }

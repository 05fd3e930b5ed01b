# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Evaluate the covariance of ``lidar_slam`` on short drives, each on different terrain.

The simulated lidar has no calibration errors, and its covariance contains none. Seeds 1, 2, 100 to 111 and
3000 to 3049 were used to fit the covariance.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_dev.compare.error_summary import error_summary
from cdff_dev.simulate.scenario import Scenario, load_scenario
from evaluation.runs.lidar_slam import EXACT_CALIBRATION, drive
from evaluation.runs.lidar_slam_page import covariance_table as table

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
#: Seeds and duration of the drives; each drive gives one NEES value.
SHORT_SEEDS, SHORT_S = range(4000, 4050), 16.0
#: Half the edge of the simulated terrain: the part of the traverse that the lidar can observe.
SHORT_HALF_WIDTH_M = 70.0


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Return the NEES of the last pose of each short drive, and the mean stated standard deviations."""
    values, sigmas_m, sigmas_deg = [], [], []
    for seed in SHORT_SEEDS:
        run = drive(short_scenario(seed), progress, slam_config={"tracking": EXACT_CALIBRATION})
        track = run.track("odometry")
        T_true = se3.inverse(run.truth[int(track.stamps_ns[0])]) @ run.truth[int(track.stamps_ns[-1])]
        C, e = track.covariances[-1], pose_error(T_true, track.matrices[-1])
        values.append(float(e @ np.linalg.solve(C, e)))
        sigmas_m.append(float(np.sqrt(np.trace(C[:3, :3]) / 3.0)))
        sigmas_deg.append(float(np.degrees(np.sqrt(np.trace(C[3:, 3:]) / 3.0))))
    n = len(values)
    return {
        "drives": n,
        "seconds": SHORT_S,
        "mean_nees": round(float(np.mean(values)), 3),
        "nees": error_summary(values),
        "band_95": [round(float(chi2.ppf(q, 6 * n)) / n, 3) for q in (0.025, 0.975)],
        "mean_sigma_m": round(float(np.mean(sigmas_m)), 5),
        "mean_sigma_deg": round(float(np.mean(sigmas_deg)), 5),
    }


def short_scenario(seed: int) -> Scenario:
    """Return a scenario of the start of the traverse, on smaller terrain with the same feature density."""
    base = load_scenario("lidar_traverse", seed)
    ground: dict[str, Any] = {"fine_half_width_m": SHORT_HALF_WIDTH_M}
    for name in ("craters", "rocks"):
        features = getattr(base.terrain, name)
        count = round(features.count * (SHORT_HALF_WIDTH_M / features.half_width_m) ** 2)
        ground[name] = features.model_copy(update={"count": count, "half_width_m": SHORT_HALF_WIDTH_M})
    return base.model_copy(update={"duration_s": SHORT_S, "terrain": base.terrain.model_copy(update=ground)})

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Whether the covariance of ``lidar_slam`` fits: drives from rest to rest, each on ground of its own.

Seeds 1, 2, 100 to 111 and 3000 to 3049 were used while the covariance was fitted.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from cdff_common.geometry import se3
from cdff_common.geometry.covariance import pose_error
from cdff_dev.evaluate._lidar_slam_drive import drive
from cdff_dev.evaluate._lidar_slam_page import covariance_table as table
from cdff_dev.evaluate.record import spread
from cdff_dev.simulate.scenario import Scenario, load_scenario

__all__ = ["evaluate", "table"]

PAGE = "lidar_slam"
#: One squared error by covariance of each.
SHORT_SEEDS, SHORT_S = range(4000, 4050), 16.0
#: Their ground: that of the traverse so far as they see it.
SHORT_HALF_WIDTH_M = 70.0


def evaluate(data: Path, progress: Callable[[str], None]) -> dict[str, Any]:
    """Squared error by covariance of the last pose of short drives from rest, each on ground of its own."""
    values, shifts_m, turns_deg = [], [], []
    for seed in SHORT_SEEDS:
        run = drive(brief(seed), progress)
        track = run.track("odometry")
        T_true = se3.inverse(run.truth[int(track.stamps_ns[0])]) @ run.truth[int(track.stamps_ns[-1])]
        C, e = track.covariances[-1], pose_error(T_true, track.matrices[-1])
        values.append(float(e @ np.linalg.solve(C, e)))
        shifts_m.append(float(np.sqrt(np.trace(C[:3, :3]) / 3.0)))
        turns_deg.append(float(np.degrees(np.sqrt(np.trace(C[3:, 3:]) / 3.0))))
    n = len(values)
    return {
        "drives": n, "seconds": SHORT_S, "mean_nees": round(float(np.mean(values)), 3), "nees": spread(values),
        "band_95": [round(float(chi2.ppf(q, 6 * n)) / n, 3) for q in (0.025, 0.975)],
        "mean_sigma_m": round(float(np.mean(shifts_m)), 5), "mean_sigma_deg": round(float(np.mean(turns_deg)), 5),
    }  # fmt: skip


def brief(seed: int) -> Scenario:
    """The begin of a traverse, on a piece of such ground with as many craters and rocks a square metre."""
    base = load_scenario("lidar_traverse", seed)
    ground: dict[str, Any] = {"fine_half_width_m": SHORT_HALF_WIDTH_M}
    for of in ("craters", "rocks"):
        part = getattr(base.terrain, of)
        count = round(part.count * (SHORT_HALF_WIDTH_M / part.half_width_m) ** 2)
        ground[of] = part.model_copy(update={"count": count, "half_width_m": SHORT_HALF_WIDTH_M})
    return base.model_copy(update={"duration_s": SHORT_S, "terrain": base.terrain.model_copy(update=ground)})

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Starts near a pose have errors of the stated sizes; results are counted: right, far, worse, flagged."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from cdff_common.geometry import se3
from evaluation.scenes.spacecraft_images import (
    SEEDS,
    START_ACROSS,
    START_DEG,
    START_RANGE,
    spacecraft_summary,
    spacecraft_table,
    start_near,
)


def row(seed: int, deg: float | None, position: float = 0.0, reasons: tuple[str, ...] = ()) -> dict[str, Any]:
    result = {
        "seed": seed,
        "cpu_s": 0.02,
        "reasons": list(reasons),
        "start": {"deg": 3.0, "position": 0.028},
    }
    return result if deg is None else result | {"deg": deg, "position": position}


@pytest.mark.parametrize("seed", range(5))
def test_a_start_has_the_stated_errors(seed: int) -> None:
    T = se3.transform(se3.exp_so3([0.3, -0.2, 1.0]), [0.1, -0.2, 8.0])
    start = start_near(T, np.random.default_rng(seed)).transform
    error = start.matrix[:3, 3] - T[:3, 3]
    range_m = float(np.linalg.norm(T[:3, 3]))
    assert np.linalg.norm(error[:2]) == pytest.approx(START_ACROSS * range_m)
    assert abs(error[2]) == pytest.approx(START_RANGE * range_m)
    angle = se3.rotation_angle(start.matrix[:3, :3].T @ T[:3, :3])
    assert np.degrees(angle) == pytest.approx(START_DEG)
    assert start.covariance is not None
    assert np.sqrt(np.trace(start.covariance[3:, 3:])) == pytest.approx(np.radians(START_DEG))


def test_results_are_counted_and_a_missing_pose_is_far_and_flagged() -> None:
    rows = [
        row(0, 1.0, 0.01),
        row(1, 1.9, 0.019, ("low_agreement:0.40<0.5",)),
        row(2, 1.0, 0.03),  # right rotation, position worse than at the start
        row(0, 6.0, 0.01),  # far and not flagged
        row(1, 7.0, 0.01, ("coasting",)),
        row(2, None),
    ]
    figures = spacecraft_summary(rows)
    assert SEEDS == 3
    assert figures["images"] == 2
    assert (figures["right_by_start"], figures["right_median"]) == ([1, 1, 0], 1.0)
    assert (figures["right"], figures["right_and_ok"]) == (2, 1)
    assert (figures["far"], figures["far_flagged"]) == (3, 2)
    assert (figures["worse"], figures["worse_flagged"]) == (3, 1)
    assert figures["median_nees"] is None
    assert "| defaults | 1 of 2 | 1 of 2 | 2 of 3 | 1 of 3 | None | 20.0 |" in spacecraft_table(
        {"defaults": figures}
    )

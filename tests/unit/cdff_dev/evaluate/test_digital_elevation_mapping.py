# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.raster import GridGeometry
from cdff_dev.evaluate.digital_elevation_mapping import dem_scores

TRUTH = GridGeometry.aligned("site", 0.05, (-3, -3, 3, 3))
MAP = GridGeometry.aligned("site", 0.05, (-1, -2, 2, 2))


def test_scores_are_those_of_the_error_put_on(rng: np.random.Generator) -> None:
    error = 0.01 + rng.normal(0.0, 0.02, MAP.shape)
    scores = dem_scores(MAP, 7.0 + error, np.full(MAP.shape, 0.02**2 + 0.01**2), TRUTH, np.full(TRUTH.shape, 7.0))
    assert scores["cells"] == MAP.rows * MAP.cols
    assert scores["bias_m"] == pytest.approx(0.01, abs=0.001)
    assert scores["rmse_m"] == pytest.approx(np.hypot(0.01, 0.02), rel=0.05)
    assert scores["nmad_m"] == pytest.approx(0.02, rel=0.05)
    assert scores["within_90_percent"] == pytest.approx(0.9, abs=0.03)


def test_unobserved_cells_and_ground_of_unknown_height_do_not_count() -> None:
    mean, heights = np.zeros(MAP.shape), np.zeros(TRUTH.shape)
    mean[:, :10] = np.nan
    heights[: TRUTH.rows // 2] = np.nan
    scores = dem_scores(MAP, mean, np.zeros(MAP.shape), TRUTH, heights)
    assert scores["cells"] == (MAP.rows // 2) * (MAP.cols - 10)
    assert dem_scores(MAP, np.full(MAP.shape, np.nan), mean, TRUTH, heights) == {"cells": 0}


def test_cells_are_compared_where_they_lie() -> None:
    x, y = TRUTH.centres_m()
    mx, my = MAP.centres_m()
    scores = dem_scores(MAP, 0.3 * mx - 0.2 * my, np.ones(MAP.shape), TRUTH, 0.3 * x - 0.2 * y)
    assert scores["rmse_m"] < 1e-12

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The calibration of lidar localisation estimates standard deviations from errors."""

from __future__ import annotations

import numpy as np
import pytest

from evaluation.lidar_localisation_calibration import sigmas


def test_sigmas_are_the_root_mean_squares_of_errors_by_axis(rng: np.random.Generator) -> None:
    true = np.array([0.01, 0.01, 0.003, *np.radians([0.02, 0.02, 0.05])])
    errors = true * rng.normal(size=(4000, 6))
    assert sigmas(errors) == pytest.approx([0.01, 0.003, 0.02, 0.05], rel=0.05)

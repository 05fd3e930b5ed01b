# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Roughness of planes with and without noise."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.cloud_matching.roughness import roughness_m

UP = np.tile([0.0, 0.0, 1.0], (5000, 1))


def test_the_roughness_of_a_plane_is_the_noise_of_two_points(rng: np.random.Generator) -> None:
    points = np.column_stack([rng.uniform(0.0, 10.0, (5000, 2)), rng.normal(0.0, 0.01, 5000)])
    assert roughness_m(points, UP) == pytest.approx(0.01 * np.sqrt(2.0), rel=0.05)


def test_an_exact_plane_has_no_roughness(rng: np.random.Generator) -> None:
    points = np.column_stack([rng.uniform(0.0, 10.0, (5000, 2)), np.zeros(5000)])
    assert roughness_m(points, UP) == 0.0

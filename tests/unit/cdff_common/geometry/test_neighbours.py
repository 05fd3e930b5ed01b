# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""``radius_neighbours`` returns the same neighbours as a k-d tree."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from cdff_common.errors import InputError
from cdff_common.geometry.neighbours import radius_neighbours


@pytest.mark.parametrize("radius_m", [0.05, 0.3, 5.0])
def test_neighbours_agree_with_a_kdtree(rng: np.random.Generator, radius_m: float) -> None:
    points, queries = rng.normal(size=(800, 3)), rng.normal(size=(60, 3)) * 2.0
    start, index = radius_neighbours(points, queries, radius_m)
    for i, expected in enumerate(cKDTree(points).query_ball_point(queries, radius_m)):
        assert sorted(index[start[i] : start[i + 1]]) == sorted(expected)


def test_a_query_far_from_all_points_has_no_neighbours() -> None:
    start, index = radius_neighbours(np.zeros((3, 3)), np.array([[100.0, 0, 0], [0, -50.0, 0]]), 1.0)
    assert start.tolist() == [0, 0, 0]
    assert len(index) == 0


@pytest.mark.parametrize("radius_m", [0.0, -1.0, float("nan")])
def test_an_invalid_radius_is_refused(radius_m: float) -> None:
    with pytest.raises(InputError, match="above 0"):
        radius_neighbours(np.zeros((3, 3)), np.zeros((1, 3)), radius_m)


def test_a_radius_too_small_for_the_extent_is_refused() -> None:
    with pytest.raises(InputError, match="too small"):
        radius_neighbours(np.array([[0.0, 0, 0], [1e9, 1e9, 1e9]]), np.zeros((1, 3)), 1e-3)

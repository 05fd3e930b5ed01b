# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The compiled height differences of start poses are those of a loop over poses, rotations and points."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_common.geometry import se3
from cdff_core.dfns.place_search._kernels import residuals

Array = np.ndarray
CELL_M, ORIGIN, CUTOFF_M = 0.5, np.array([-3.0, 2.0]), 0.5


def mean_difference(heights: Array, T: Array, turn: Array, points: Array, min_covered: float) -> float:
    """Return the mean of the limited differences over the points on known cells, or infinity."""
    c, s = turn
    moved_points = se3.transform_points(T, points @ np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]]))
    cells = np.floor((moved_points[:, :2] - ORIGIN) / CELL_M).astype(int)
    inside = np.all((cells >= 0) & (cells < heights.shape), axis=1)
    known = heights[tuple(cells[inside].T)]
    differences = np.minimum(np.abs(moved_points[inside, 2] - known), CUTOFF_M)
    differences = differences[~np.isnan(known)]
    if len(differences) == 0 or len(differences) < min_covered * len(points):
        return np.inf
    return float(differences.mean())


@pytest.mark.parametrize("min_covered", [0.0, 0.3, 0.8])
def test_mean_differences_are_those_of_the_known_cells(min_covered: float) -> None:
    rng = np.random.default_rng(1)
    heights = rng.normal(0.0, 0.2, (9, 12))
    heights[rng.random(heights.shape) < 0.2] = np.nan
    starts = np.array(
        [se3.exp_se3([x, y, 0.1, 0.2, -0.1, 0.3]) for x, y in ((-1.0, 4.0), (0.5, 5.5), (9.0, 9.0))]
    )
    angles = np.array([0.0, 1.0, 4.0])
    rotations = np.column_stack([np.cos(angles), np.sin(angles)])
    points = rng.uniform(-3.0, 3.0, (39, 3)) * [1.0, 1.0, 0.2]
    out = residuals(heights, ORIGIN, CELL_M, starts, rotations, points, CUTOFF_M, min_covered)
    expected = [[mean_difference(heights, T, r, points, min_covered) for r in rotations] for T in starts]
    np.testing.assert_allclose(out, expected, rtol=1e-12)


def flat(count: int, differences: Array, min_covered: float = 0.5) -> float:
    """Return the mean difference of points above a map of one cell at height 0."""
    points = np.zeros((count, 3))
    points[: len(differences), 2] = differences
    heights, T = np.zeros((1, 1)), se3.transform(np.eye(3), [0.25, 0.25, 0.0])
    turn = np.array([[1.0, 0.0]])
    return float(residuals(heights, np.zeros(2), CELL_M, T[None], turn, points, CUTOFF_M, min_covered)[0, 0])


def test_a_pose_with_a_large_difference_after_forty_points_is_rejected() -> None:
    """The limit is 0.6 of the cut-off, here 12 m in sum."""
    assert flat(80, np.full(24, 1.0)) == pytest.approx(24 * CUTOFF_M / 80)
    assert flat(80, np.full(25, 1.0), min_covered=0.0) == np.inf
    assert flat(39, np.full(39, 1.0)) == pytest.approx(CUTOFF_M)
    late = np.r_[np.zeros(40), np.full(40, 1.0)]
    assert flat(80, late) == pytest.approx(CUTOFF_M / 2.0)
    assert flat(80, late[1:]) == pytest.approx(CUTOFF_M / 2.0)


def test_the_least_fraction_of_known_cells_is_included() -> None:
    points = np.zeros((4, 3))
    points[:2, 0] = 100.0
    heights, T, turn = np.zeros((1, 1)), se3.transform(np.eye(3), [0.25, 0.25, 0.1]), np.array([[1.0, 0.0]])
    for min_covered, expected in ((0.5, 0.1), (0.51, np.inf), (0.0, 0.1)):
        out = residuals(heights, np.zeros(2), CELL_M, T[None], turn, points, CUTOFF_M, min_covered)
        assert out[0, 0] == pytest.approx(expected)
    out = residuals(heights, np.zeros(2), CELL_M, T[None], turn, points[:2], CUTOFF_M, 0.0)
    assert out[0, 0] == np.inf
    assert residuals(heights, np.zeros(2), CELL_M, T[None], turn, points[2:3], CUTOFF_M, 1.0)[
        0, 0
    ] == pytest.approx(0.1)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Planes at the points of a compiled map registration are those of least squares over the observed cells."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.dem_registration._kernels import tangent_planes

Array = np.ndarray
RESOLUTION_M, XMIN_M, YMAX_M = 0.25, -1.0, 3.0


def computed(points: Array, heights: Array, radius: int) -> tuple[Array, Array, Array]:
    n = len(points)
    above, gradient, variance = np.empty(n), np.full((n, 2), -7.0), np.full(n, -7.0)
    tangent_planes(points, heights, RESOLUTION_M, XMIN_M, YMAX_M, radius, above, gradient, variance)
    return above, gradient, variance


def plane(point: Array, heights: Array, radius: int) -> tuple[float, Array, float] | None:
    """Return height above the plane, gradient and variance; None without a plane."""
    row = int(np.floor((YMAX_M - point[1]) / RESOLUTION_M))
    col = int(np.floor((point[0] - XMIN_M) / RESOLUTION_M))
    if min(row, col) < radius or row + radius >= heights.shape[0] or col + radius >= heights.shape[1]:
        return None
    r, c = np.mgrid[row - radius : row + radius + 1, col - radius : col + radius + 1]
    z = heights[r, c].astype(np.float64)
    known = ~np.isnan(z)
    x = XMIN_M + (c[known] + 0.5) * RESOLUTION_M - point[0]
    y = YMAX_M - (r[known] + 0.5) * RESOLUTION_M - point[1]
    if known.sum() < (2 * radius + 1) ** 2 // 2:
        return None
    moments = np.cov([x, y], bias=True)
    if np.linalg.det(moments) < 1e-3 * np.trace(moments) ** 2:
        return None
    A = np.column_stack([x, y, np.ones(len(x))])
    solution = np.linalg.lstsq(A, z[known] - point[2], rcond=None)[0]
    residual = z[known] - point[2] - A @ solution
    return -solution[2], solution[:2], np.mean(residual**2) / len(x)


@pytest.mark.parametrize(("radius", "unknown"), [(1, 0.0), (1, 0.4), (2, 0.5), (2, 0.7)])
def test_planes_are_those_of_least_squares(radius: int, unknown: float) -> None:
    rng = np.random.default_rng(4)
    heights = rng.normal(0.0, 0.1, (10, 12)).astype(np.float32)
    heights[rng.random(heights.shape) < unknown] = np.nan
    points = np.column_stack(
        [rng.uniform(-1.2, 2.2, 60), rng.uniform(0.3, 3.2, 60), rng.normal(0.0, 1.0, 60)]
    )
    above, gradient, variance = computed(points, heights, radius)
    planes = [plane(p, heights, radius) for p in points]
    assert any(p is None for p in planes)
    assert any(p is not None for p in planes)
    for i, expected in enumerate(planes):
        if expected is None:
            assert np.isnan(above[i])
            assert gradient[i].tolist() == [-7.0, -7.0]
            assert variance[i] == -7.0
        else:
            np.testing.assert_allclose(above[i], expected[0], atol=1e-10)
            np.testing.assert_allclose(gradient[i], expected[1], atol=1e-9)
            assert variance[i] == pytest.approx(expected[2], rel=1e-6, abs=1e-12)


def test_the_square_of_cells_lies_within_the_map() -> None:
    heights = np.zeros((5, 5), np.float32)
    for x, y, is_inside in (
        (-0.75, 2.75, True), (-0.751, 2.5, False), (-0.5, 2.751, False), (-0.001, 2.001, True), (0.0, 2.5, False),
        (-0.5, 2.0, False),
    ):  # fmt: skip
        above, _, _ = computed(np.array([[x, y, 0.5]]), heights, 1)
        assert (above[0] == pytest.approx(0.5)) == is_inside


def test_fewer_than_half_of_the_cells_or_a_line_of_cells_give_no_plane() -> None:
    point, heights = np.array([[-0.375, 2.375, 0.5]]), np.zeros((5, 5), np.float32)
    centre = heights[1:4, 1:4]
    centre[:] = np.nan
    centre[0, 0] = centre[0, 2] = centre[2, 0] = centre[2, 2] = 0.0
    assert computed(point, heights, 1)[0][0] == pytest.approx(0.5)
    centre[2, 2] = np.nan
    assert np.isnan(computed(point, heights, 1)[0][0])
    square = np.full((5, 5), np.nan, np.float32)
    square[2] = square[:, 2] = 0.0
    square[0, 0] = square[4, 4] = square[4, 0] = 0.0
    assert computed(point, square, 2)[0][0] == pytest.approx(0.5)

# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Refinement on a height grid: exact surfaces, known placements, and the covariance by its formula."""

from __future__ import annotations

import numpy as np
import pytest

from cdff_core.dfns.raster_matching._refinement import HeightSurface, Placement, refine_placement

ROWS, COLS = 60, 70
MIDDLE = (30.0, 34.0)


def hills(row: np.ndarray, col: np.ndarray) -> np.ndarray:
    return 2.0 * np.sin(0.21 * row + 0.3) * np.cos(0.17 * col) + 0.8 * np.sin(0.13 * (row + 2.0 * col))


def grid() -> np.ndarray:
    return hills(*np.mgrid[0:ROWS, 0:COLS].astype(np.float64))


def placed(
    surface: HeightSurface, d_row: float, d_col: float, rotation: float, height: float, tilt: float = 0.0,
    noise_m: float = 0.0,
) -> Placement | None:  # fmt: skip
    """Return the refinement of points whose true placement is given."""
    rng = np.random.default_rng(4)
    y, x = (a.ravel().astype(np.float64) for a in np.mgrid[-15:16, -15:16])
    c, s = np.cos(rotation), np.sin(rotation)
    z = hills(MIDDLE[0] + d_row + c * y - s * x, MIDDLE[1] + d_col + c * x + s * y)
    z += rng.normal(0.0, noise_m, z.shape) - height - tilt * y
    return refine_placement(surface, MIDDLE[0] + y, MIDDLE[1] + x, z, MIDDLE)


def test_heights_and_slopes_of_a_plane_are_exact_and_outside_is_not_observed() -> None:
    row, col = np.mgrid[0:20, 0:30].astype(np.float64)
    heights = 0.5 * row - 0.25 * col + 3.0
    heights[8, 9] = np.nan
    surface = HeightSurface.from_grid(heights)
    at_row = np.array([10.3, 8.4, 8.6, 0.0, -0.1, 19.0, 19.1, 5.0, 5.0, 5.0, 5.0])
    at_col = np.array([12.7, 9.4, 9.4, 5.0, 5.0, 5.0, 5.0, 0.0, -0.1, 29.0, 29.1])
    z, slope_row, slope_col, observed = surface.at(at_row, at_col)
    assert observed.tolist() == [True, False, True, True, False, True, False, True, False, True, False]
    assert z[0] == pytest.approx(0.5 * 10.3 - 0.25 * 12.7 + 3.0, abs=1e-2)
    assert (slope_row[0], slope_col[0]) == pytest.approx((0.5, -0.25), abs=1e-2)


def test_a_placement_is_found_to_a_hundredth_of_a_cell() -> None:
    placement = placed(HeightSurface.from_grid(grid()), 0.7, -0.6, 0.03, 5.0)
    assert placement is not None
    assert (placement.row, placement.col) == pytest.approx((0.7, -0.6), abs=0.01)
    assert placement.rotation_rad == pytest.approx(0.03, abs=1e-3)
    assert placement.height_m == pytest.approx(5.0, abs=1e-2)
    assert placement.residual_m < 0.01
    assert placement.cells == 31 * 31


def test_a_tilt_of_the_points_is_estimated_with_the_placement() -> None:
    placement = placed(HeightSurface.from_grid(grid()), 0.3, 0.2, -0.02, 1.0, tilt=0.05)
    assert placement is not None
    assert (placement.row, placement.col) == pytest.approx((0.3, 0.2), abs=0.01)
    assert placement.residual_m < 0.01


def test_the_covariance_is_that_of_clustered_least_squares_at_the_solution() -> None:
    surface = HeightSurface.from_grid(grid())
    placement = placed(surface, 0.0, 0.0, 0.0, 0.0, noise_m=0.02)
    assert placement is not None
    assert placement.residual_m == pytest.approx(0.02, rel=0.1)
    # The same model by central differences: heights of the surface less those of the moved points.
    rng = np.random.default_rng(4)
    y, x = (a.ravel().astype(np.float64) for a in np.mgrid[-15:16, -15:16])
    z = hills(MIDDLE[0] + y, MIDDLE[1] + x) + rng.normal(0.0, 0.02, y.shape)
    tilts = np.zeros(2)

    def errors(p: np.ndarray) -> np.ndarray:
        d_row, d_col, rotation, height = p[:4]
        c, s = np.cos(rotation), np.sin(rotation)
        heights = surface.at(MIDDLE[0] + d_row + c * y - s * x, MIDDLE[1] + d_col + c * x + s * y)[0]
        return heights - z - height - p[4] * y - p[5] * x

    p = np.array([placement.row, placement.col, placement.rotation_rad, placement.height_m, *tilts])
    for _ in range(5):  # the tilts are not part of the result
        J = np.column_stack([(errors(p + 1e-3 * u) - errors(p - 1e-3 * u)) / 2e-3 for u in np.eye(6)])
        e = errors(p)
        w = np.minimum(1.0, 1.345 * 1.4826 * np.median(np.abs(e - np.median(e))) / np.abs(e))
        p[4:] -= np.linalg.solve(J.T @ (w[:, None] * J), J.T @ (w * e))[4:]
    inverse = np.linalg.inv(J.T @ (w[:, None] * J))
    blocks = np.array([MIDDLE[0] + y, MIDDLE[1] + x]) // 4
    _, index = np.unique(blocks, axis=1, return_inverse=True)
    scores = np.array(
        [((w * e)[:, None] * J)[index.ravel() == k].sum(axis=0) for k in range(index.max() + 1)]
    )
    expected = (inverse @ scores.T @ scores @ inverse)[np.ix_([1, 0, 3, 2], [1, 0, 3, 2])]
    np.testing.assert_allclose(np.diag(placement.covariance), np.diag(expected), rtol=0.15)
    deviation = (
        z
        - np.column_stack([np.ones_like(x), x, y])
        @ np.linalg.lstsq(np.column_stack([np.ones_like(x), x, y]), z, rcond=None)[0]
    )
    assert placement.relief_m == pytest.approx(np.sqrt(np.mean(deviation**2)))


def test_outliers_have_a_bounded_influence() -> None:
    heights = grid()
    heights[20:24, 20:24] += 5.0
    placement = placed(HeightSurface.from_grid(heights), 0.7, -0.6, 0.0, 0.0)
    assert placement is not None
    assert (placement.row, placement.col) == pytest.approx((0.7, -0.6), abs=0.1)


def test_a_plane_constrains_no_translation_and_points_off_the_grid_no_placement() -> None:
    row, col = np.mgrid[0:ROWS, 0:COLS].astype(np.float64)
    assert placed(HeightSurface.from_grid(0.1 * row + 0.2 * col), 0.0, 0.0, 0.0, 0.0) is None
    surface = HeightSurface.from_grid(grid())
    y, x = (a.ravel().astype(np.float64) for a in np.mgrid[-15:16, -15:16])
    assert refine_placement(surface, y - 30.0, x + 34.0, np.zeros_like(x), (-30.0, 34.0)) is None


@pytest.mark.parametrize(("rows_inside", "is_found"), [(10, False), (12, True)])
def test_a_third_of_the_points_on_the_grid_is_required(rows_inside: int, is_found: bool) -> None:
    y, x = (a.ravel().astype(np.float64) for a in np.mgrid[-15:16, -15:16])
    row, col = y - y.max() + rows_inside - 1.0, MIDDLE[1] + x
    surface = HeightSurface.from_grid(grid())
    placement = refine_placement(surface, row, col, hills(row, col), (float(row.mean()), MIDDLE[1]))
    assert (placement is not None) == is_found
    assert placement is None or (placement.row, placement.col) == pytest.approx((0.0, 0.0), abs=0.05)

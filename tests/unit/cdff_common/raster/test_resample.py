# SPDX-FileCopyrightText: 2026 the CDFF contributors
# SPDX-License-Identifier: BSD-3-Clause
from __future__ import annotations

import numpy as np
import pytest

from cdff_common.errors import InputError
from cdff_common.raster import (
    CellStatistics,
    GridGeometry,
    aggregate,
    delivered_resolution,
)
from cdff_common.raster.resample import area_means

T_NS = 1_700_000_000_000_000_000


def patch(
    rng: np.random.Generator, resolution_m: float, bounds: tuple[float, float, float, float], n: int = 3000
):
    x = rng.uniform(bounds[0], bounds[2], n)
    y = rng.uniform(bounds[1], bounds[3], n)
    points = np.column_stack([x, y, 100.0 + rng.normal(0.0, 0.5, n)])
    g = GridGeometry.aligned("site", resolution_m, bounds)
    return points, CellStatistics.from_points(g, points, stamps_ns=T_NS + 1000 * rng.integers(0, 99, n))


def test_aggregated_cells_equal_the_statistics_of_their_points(rng: np.random.Generator) -> None:
    points, fine = patch(rng, 0.05, (-0.35, -0.15, 1.1, 0.85))
    coarse = aggregate(fine, 4)
    direct = CellStatistics.from_points(coarse.geometry, points, stamps_ns=T_NS)
    for name in ("count", "mean", "m2", "minimum", "maximum"):
        np.testing.assert_allclose(
            getattr(coarse, name), getattr(direct, name), rtol=1e-12, atol=1e-9, err_msg=name
        )
    assert coarse.newest_ns.max() == fine.newest_ns.max()


def test_a_coarse_cell_is_unobserved_only_where_all_its_cells_are() -> None:
    g = GridGeometry.aligned("site", 0.5, (0, 0, 2, 2))
    coarse = aggregate(CellStatistics.from_points(g, [[0.1, 1.9, 3.0]], stamps_ns=T_NS), 2)
    assert coarse.observed.tolist() == [[True, False], [False, False]]


@pytest.mark.parametrize(
    ("data_m", "requested_m", "expected_m"),
    [
        ([0.05], 0.05, 0.05),
        ([0.05], 0.12, 0.1),
        ([0.05], 0.01, 0.05),
        ([0.05, 0.2], 0.05, 0.2),
        ([0.1], None, 0.1),
        ([0.05], 0.15, 0.15),
    ],
)
def test_delivered_cells_are_never_finer_than_the_data_nor_coarser_than_requested(
    data_m: list[float], requested_m: float | None, expected_m: float
) -> None:
    assert delivered_resolution(data_m, requested_m) == pytest.approx(expected_m)


@pytest.mark.parametrize(
    ("data_m", "requested_m"), [([], 0.1), ([0.05], 0.0), ([0.05], float("nan")), ([0.03, 0.05], None)]
)
def test_cell_sizes_that_cannot_be_aggregated_are_refused(
    data_m: list[float], requested_m: float | None
) -> None:
    with pytest.raises(InputError):
        delivered_resolution(data_m, requested_m)


def test_aggregating_by_less_than_one_is_refused(rng: np.random.Generator) -> None:
    with pytest.raises(InputError, match="factor"):
        aggregate(patch(rng, 0.5, (0, 0, 2, 2))[1], 0)


def test_area_means_of_a_whole_number_of_cells_are_block_means(rng: np.random.Generator) -> None:
    heights = rng.normal(1000.0, 1.0, (8, 6))
    mean, variance = area_means(heights, (0.0, 0.0, 6.0, 8.0), GridGeometry("site", 2.0, 0.0, 8.0, 4, 3))
    blocks = heights.reshape(4, 2, 3, 2)
    np.testing.assert_allclose(mean, blocks.mean(axis=(1, 3)))
    np.testing.assert_allclose(variance, blocks.var(axis=(1, 3)), atol=1e-9)


@pytest.mark.parametrize(("cell_m", "atol"), [(1.0, 1e-9), (2.0, 1e-9), (1.5, 0.04), (1.1, 0.04)])
def test_area_means_of_a_plane_are_the_heights_of_the_centres(cell_m: float, atol: float) -> None:
    bounds = (0.7, -19.7, 20.7, 0.3)
    row, col = np.indices((20, 20)) + 0.5
    grid = GridGeometry.aligned("site", cell_m, bounds)
    mean, _ = area_means(0.5 * col - 0.25 * row, bounds, grid)
    x, y = grid.centres_m()
    inner = (np.abs(x - 10.7) < 7.0) & (np.abs(y + 9.7) < 7.0)
    np.testing.assert_allclose(mean[inner], (0.5 * (x - 0.7) - 0.25 * (0.3 - y))[inner], atol=atol)


def test_area_means_are_unobserved_where_less_than_nine_tenths_are_observed() -> None:
    heights = np.ones((4, 4))
    heights[1, 1] = np.nan
    mean, variance = area_means(heights, (0.0, 0.0, 4.0, 4.0), GridGeometry("site", 2.0, 0.0, 4.0, 2, 3))
    np.testing.assert_array_equal(np.isnan(mean), [[True, False, True], [False, False, True]])
    np.testing.assert_array_equal(np.isnan(variance), np.isnan(mean))
